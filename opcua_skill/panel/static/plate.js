// A plate to scale: each stroke of mouse, pen or finger is told with its samples in mm and its times in s.
const PALM = 70; // px across: what touches more broadly is no finger

export default {
  template: `<canvas ref="canvas" class="plate"></canvas>`,
  props: { width: Number, height: Number, drawing: Boolean },
  mounted() {
    this.strokes = [];
    this.now = null;
    this.tracked = []; // of a tracker: [x, y, pressed], in mm
    this.area = [0, 0, this.width, this.height];
    this.context = this.$refs.canvas.getContext("2d");
    this.observer = new ResizeObserver(() => this.fit());
    this.observer.observe(this.$el.parentElement);
    const canvas = this.$refs.canvas;
    canvas.addEventListener("pointerdown", (e) => this.begin(e));
    canvas.addEventListener("pointermove", (e) => this.go(e));
    canvas.addEventListener("pointerup", (e) => this.end(e));
    canvas.addEventListener("pointercancel", (e) => this.broken(e));
    canvas.addEventListener("contextmenu", (e) => e.preventDefault()); // a long press is the beginning of a slow stroke
    this.fit();
  },
  beforeUnmount() { this.observer.disconnect(); },
  methods: {
    fit() {
      const canvas = this.$refs.canvas, room = this.$el.parentElement.clientWidth, high = Math.max(300, window.innerHeight - 250);
      const [x0, y0, x1, y1] = this.area, wide = x1 - x0, tall = y1 - y0;
      this.scale = Math.min(room / (1.18 * wide), high / (1.13 * tall));
      const ratio = window.devicePixelRatio || 1;
      this.across = room; this.up = 1.13 * this.scale * tall;
      canvas.width = Math.round(this.across * ratio); canvas.height = Math.round(this.up * ratio);
      canvas.style.height = `${this.up}px`;
      this.context.setTransform(ratio, 0, 0, ratio, 0, 0);
      this.left = (this.across - this.scale * wide) / 2 - this.scale * x0; this.bottom = this.up - 0.065 * this.scale * tall + this.scale * y0;
      this.draw();
    },
    // strokes: [{id, points: [[x, y] mm], used}]
    show(strokes) { this.strokes = strokes; this.draw(); },
    // samples of a tracker: {points: [[x, y] mm], pressed, begin: whether a new recording begins}
    track(told) {
      if (told.begin) { this.tracked = []; this.ranges = null; this.area = [0, 0, this.width, this.height]; }
      let [x0, y0, x1, y1] = this.area;
      told.points.forEach(([x, y], i) => {
        this.tracked.push([x, y, told.pressed[i]]);
        x0 = Math.min(x0, x); y0 = Math.min(y0, y); x1 = Math.max(x1, x); y1 = Math.max(y1, y);
      });
      const grown = x0 < this.area[0] || y0 < this.area[1] || x1 > this.area[2] || y1 > this.area[3];
      if (grown) this.area = [x0 - 0.05 * (x1 - x0), y0 - 0.05 * (y1 - y0), x1 + 0.05 * (x1 - x0), y1 + 0.05 * (y1 - y0)];
      this.$el.dataset.tracked = this.tracked.length;
      this.$el.dataset.pressed = this.tracked.filter((one) => one[2]).length;
      if (grown || told.begin) this.fit(); else this.draw();
    },
    // ranges: [[first, last]] of the samples that are demonstrations
    presses(ranges) { this.ranges = ranges; this.draw(); },
    px(x, y) { return [this.left + this.scale * x, this.bottom - this.scale * y]; },
    mm(e) {
      const box = this.$refs.canvas.getBoundingClientRect();
      return [(e.clientX - box.left - this.left) / this.scale, (this.bottom - (e.clientY - box.top)) / this.scale];
    },
    begin(e) {
      if (!this.drawing || (e.pointerType === "mouse" && e.button !== 0)) return;
      if (e.pointerType === "touch" && Math.max(e.width, e.height) > PALM) return;
      const handBefore = this.now?.kind === "touch" && e.pointerType === "pen"; // the hand lay down first, the pen is meant
      if (this.now && !handBefore) return;
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
    // The browser took the pointer away: half a stroke is no demonstration.
    broken(e) {
      if (!this.now || e.pointerId !== this.now.pointer) return;
      this.now = null;
      this.draw();
      this.$emit("broken", {});
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
      const [l, b] = this.px(0, 0), [r, t] = this.px(this.width, this.height), [x0, y0, x1, y1] = this.area;
      c.fillStyle = "#f7f9fb"; c.fillRect(l, t, r - l, b - t);
      const step = Math.max(x1 - x0, y1 - y0) > 400 ? 100 : 10, from = (low) => Math.ceil(low / step - 1e-9) * step;
      for (let x = from(x0); x <= x1 + 1e-9; x += step) this.line([[x, y0], [x, y1]], "#e3e9ef", 1, []);
      for (let y = from(y0); y <= y1 + 1e-9; y += step) this.line([[x0, y], [x1, y]], "#e3e9ef", 1, []);
      c.strokeStyle = "#5b6b7b"; c.lineWidth = 1.5; c.strokeRect(l, t, r - l, b - t);
      c.fillStyle = "#5b6b7b"; c.font = "13px Roboto, sans-serif";
      c.fillText("0", l - 12, b + 14); c.fillText(`${this.width} mm`, r - 44, b + 16); c.fillText(`${this.height} mm`, l - 52, t + 12);
      for (const one of this.strokes) {
        this.line(one.points, one.used ? "#7b8a99" : "#b9c3cd", one.used ? 2 : 1.2, one.used ? [] : [3, 4]);
        if (one.points.length) { const [x, y] = this.px(...one.points[0]); c.beginPath(); c.arc(x, y, 4, 0, 7); c.fillStyle = "#1f5fa8"; c.fill(); }
      }
      this.drawTracked(c);
      if (this.now) this.line(this.now.x.map((x, i) => [x, this.now.y[i]]), "#1f5fa8", 3, []);
    },
    // pressed: a thick line; between presses: fine dots; where it is now: a ring, filled while the button is pressed
    drawTracked(c) {
      const all = this.tracked, step = Math.max(1, Math.floor(all.length / 6000));
      let run = [];
      for (let i = 0; i <= all.length; i++) {
        const one = all[i];
        if (one && one[2]) { if (!(i % step) || !run.length) run.push(one); continue; }
        if (run.length) {
          const kept = !this.ranges || this.ranges.some(([first, last]) => i - 1 >= first && i - 1 <= last + 2);
          this.line(run, kept ? "#1f5fa8" : "#b9c3cd", kept ? 2.5 : 1.2, kept ? [] : [3, 4]);
          run = [];
        }
        if (one && !(i % Math.max(step, 3))) { const [x, y] = this.px(one[0], one[1]); c.fillStyle = "#9aa9b8"; c.fillRect(x - 1, y - 1, 2, 2); }
      }
      const last = all[all.length - 1];
      if (!last) return;
      const [x, y] = this.px(last[0], last[1]);
      c.beginPath(); c.arc(x, y, 7, 0, 7); c.fillStyle = last[2] ? "#b45309" : "white"; c.fill(); c.lineWidth = 2.5; c.strokeStyle = "#b45309"; c.stroke();
    },
  },
};
