// A plate to scale: each stroke of mouse, pen or finger is told with its samples in mm and its times in s.
export default {
  template: `<canvas ref="canvas" class="plate"></canvas>`,
  props: { width: Number, height: Number, drawing: Boolean },
  mounted() {
    this.strokes = [];
    this.now = null;
    this.context = this.$refs.canvas.getContext("2d");
    this.observer = new ResizeObserver(() => this.fit());
    this.observer.observe(this.$el.parentElement);
    const canvas = this.$refs.canvas;
    canvas.addEventListener("pointerdown", (e) => this.begin(e));
    canvas.addEventListener("pointermove", (e) => this.go(e));
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (e) => this.end(e));
    this.fit();
  },
  beforeUnmount() { this.observer.disconnect(); },
  methods: {
    fit() {
      const canvas = this.$refs.canvas, room = this.$el.parentElement.clientWidth, high = Math.max(300, window.innerHeight - 250);
      this.scale = Math.min(room / (this.width + 12), high / (this.height + 12));
      const ratio = window.devicePixelRatio || 1;
      this.across = room; this.up = this.scale * (this.height + 12);
      canvas.width = Math.round(this.across * ratio); canvas.height = Math.round(this.up * ratio);
      canvas.style.height = `${this.up}px`;
      this.context.setTransform(ratio, 0, 0, ratio, 0, 0);
      this.left = (this.across - this.scale * this.width) / 2; this.bottom = this.up - 6 * this.scale;
      this.draw();
    },
    // strokes: [{id, points: [[x, y] mm], used}]
    show(strokes) { this.strokes = strokes; this.draw(); },
    px(x, y) { return [this.left + this.scale * x, this.bottom - this.scale * y]; },
    mm(e) {
      const box = this.$refs.canvas.getBoundingClientRect();
      return [(e.clientX - box.left - this.left) / this.scale, (this.bottom - (e.clientY - box.top)) / this.scale];
    },
    begin(e) {
      if (!this.drawing || this.now || (e.pointerType === "mouse" && e.button !== 0)) return;
      this.$refs.canvas.setPointerCapture(e.pointerId);
      this.now = { pointer: e.pointerId, kind: e.pointerType, start: e.timeStamp, t: [], x: [], y: [] };
      this.add(e);
    },
    add(e) {
      const [x, y] = this.mm(e), t = (e.timeStamp - this.now.start) / 1000;
      if (this.now.t.length && t <= this.now.t[this.now.t.length - 1]) return;
      this.now.t.push(t); this.now.x.push(x); this.now.y.push(y);
    },
    go(e) {
      if (!this.now || e.pointerId !== this.now.pointer) return;
      const all = e.getCoalescedEvents ? e.getCoalescedEvents() : [];
      for (const one of all.length ? all : [e]) this.add(one);
      this.draw();
    },
    end(e) {
      if (!this.now || e.pointerId !== this.now.pointer) return;
      const { t, x, y, kind } = this.now;
      this.now = null;
      this.draw();
      this.$emit("stroke", { t, x, y, kind });
    },
    line(points, colour, width, dash) {
      const c = this.context;
      c.beginPath(); c.strokeStyle = colour; c.lineWidth = width; c.setLineDash(dash); c.lineJoin = "round"; c.lineCap = "round";
      let pen = false;
      for (const [x, y] of points) {
        if (x === null || y === null || !isFinite(x) || !isFinite(y)) { pen = false; continue; }
        if (pen) c.lineTo(...this.px(x, y)); else c.moveTo(...this.px(x, y));
        pen = true;
      }
      c.stroke(); c.setLineDash([]);
    },
    draw() {
      const c = this.context;
      c.clearRect(0, 0, this.across, this.up);
      const [l, b] = this.px(0, 0), [r, t] = this.px(this.width, this.height);
      c.fillStyle = "#f7f9fb"; c.fillRect(l, t, r - l, b - t);
      for (let x = 0; x <= this.width + 1e-9; x += 10) this.line([[x, 0], [x, this.height]], "#e3e9ef", 1, []);
      for (let y = 0; y <= this.height + 1e-9; y += 10) this.line([[0, y], [this.width, y]], "#e3e9ef", 1, []);
      c.strokeStyle = "#5b6b7b"; c.lineWidth = 1.5; c.strokeRect(l, t, r - l, b - t);
      c.fillStyle = "#5b6b7b"; c.font = "13px Roboto, sans-serif";
      c.fillText("0", l - 12, b + 14); c.fillText(`${this.width} mm`, r - 44, b + 16); c.fillText(`${this.height} mm`, l - 52, t + 12);
      for (const one of this.strokes) {
        this.line(one.points, one.used ? "#7b8a99" : "#b9c3cd", one.used ? 2 : 1.2, one.used ? [] : [3, 4]);
        if (one.points.length) { const [x, y] = this.px(...one.points[0]); c.beginPath(); c.arc(x, y, 4, 0, 7); c.fillStyle = "#1f5fa8"; c.fill(); }
      }
      if (this.now) this.line(this.now.x.map((x, i) => [x, this.now.y[i]]), "#1f5fa8", 3, []);
    },
  },
};
