// Demonstrations, learned path, tube and components on one ECharts canvas; samples are picked here, decided elsewhere.
// The lines are drawn once. What a click changes lies on a plain canvas of its own, so that the lines are not painted again.
import { echarts } from "nicegui-echart";

const GREY = "#9aa9b8", FLAG = "#d97706", BLUE = "#1f5fa8", RED = "#c62828", SOFT = "#5b6b7b", GREEN = "#2e7d32";
const REACH = 16, FINGER = 24, DRAWN = 450, CROSS = 3.6;
const LINES = [["ghost", SOFT, 2, [8, 5]], ["other", GREEN, 2.5, [2, 4]], ["preview", RED, 2, [6, 5]]];

const finger = (e) => String(e.event?.type).startsWith("touch");

function floats(text) {
  const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  return new Float32Array(bytes.buffer);
}

export default {
  template: `<div style="position:relative"><div ref="chart" style="position:absolute;inset:0"></div>
    <canvas ref="over" style="position:absolute;inset:0;width:100%;height:100%;pointer-events:none"></canvas>
    <div ref="box" style="position:absolute;display:none;border:2px dashed #c62828;background:rgba(198,40,40,.08);pointer-events:none"></div>
    <div ref="tip" style="position:absolute;display:none;background:#1d2733;color:white;font-size:13px;padding:2px 8px;border-radius:4px;pointer-events:none;white-space:nowrap"></div></div>`,
  props: { data: Object, state: Object },
  async mounted() {
    await new Promise((done) => setTimeout(done, 0));
    this.chart = echarts.init(this.$refs.chart);
    this.lines = [];
    this.current = { view: "path", mode: "aligned", tube: true, components: false, tool: "point", target: "one" };
    this.over = {};
    this.anchor = null;
    this.observer = new ResizeObserver(() => { this.chart.resize(); this.arrange(); });
    this.chart.on("datazoom", () => this.drawOver());
    this.observer.observe(this.$el);
    this.listen();
    if (this.data) this.load(this.data);
    if (this.state) this.show(this.state);
    this.$emit("drawn", {});
  },
  beforeUnmount() {
    this.observer?.disconnect();
    this.chart?.dispose();
  },
  methods: {
    load(data) {
      this.info = data;
      const d = data.dimension;
      const unpack = (line) => ({ id: line.id, flagged: line.flagged, used: line.used, place: line.place,
        raw: { points: floats(line.raw), clock: floats(line.raw_clock) },
        aligned: { points: floats(line.aligned), clock: floats(line.aligned_clock) } });
      this.lines = data.lines.map(unpack);
      this.path = { points: floats(data.path.points), clock: floats(data.path.clock) };
      this.d = d;
    },
    // state: view, mode, tube, components, tool, target; anything left out stays as it is
    show(state) {
      const before = this.current;
      this.current = { ...before, ...state };
      if (["view", "mode", "tube", "components"].some((key) => key in state) || !this.drawn) this.draw();
      const pan = this.current.tool === "move";
      this.chart.setOption({ dataZoom: this.zooms(pan) });
      this.drawOver();
      Object.assign(this.$el.dataset, { tool: this.current.tool, target: this.current.target });
      this.$refs.chart.style.cursor = pan ? "grab" : "crosshair";
      // a finger scrolls the page over the chart, unless it draws a box or moves the lines
      this.$refs.chart.style.touchAction = pan || this.current.tool === "box" ? "none" : "pan-y";
    },
    // overlay: struck {line: [indices in the current mode]}, excluded [ids], preview / ghost / other: packed paths, highlight id
    overlay(over) {
      if (!this.drawn) return; // it is sent again once the lines are there
      const gone = this.over.excluded || [];
      for (const [key] of LINES) if (over[key]) over[key] = { points: floats(over[key].points), clock: floats(over[key].clock) };
      this.over = { ...this.over, ...over };
      const now = this.over.excluded || [], changed = this.lines.flatMap((line, i) => gone.includes(line.id) === now.includes(line.id) ? [] : [i]);
      if (changed.length)
        this.chart.setOption({ series: this.grids().flatMap((_, g) => changed.map((i) => ({ id: `d${g}-${i}`, lineStyle: this.style(this.lines[i]) }))) });
      this.drawOver();
      this.count("painted");
    },
    // Tells tests and benchmarks that something is on the screen: two frames after it was drawn.
    count(what) {
      requestAnimationFrame(() => requestAnimationFrame(() => { this.$el.dataset[what] = Number(this.$el.dataset[what] || 0) + 1; }));
    },
    grids() {
      const time = this.current.view === "time";
      if (time) return [...Array(this.d).keys()].map((k) => ({ x: "t", y: k }));
      return this.d === 2 ? [{ x: 0, y: 1 }] : [{ x: 0, y: 1 }, { x: 0, y: 2 }];
    },
    value(set, i, dim) { return dim === "t" ? set.clock[i] : set.points[i * this.d + dim]; },
    flat(set, grid, count, step = 1) {
      const out = [];
      for (let i = 0; i < count; i += step) out.push([this.value(set, i, grid.x), this.value(set, i, grid.y)]);
      if (count && (count - 1) % step) out.push([this.value(set, count - 1, grid.x), this.value(set, count - 1, grid.y)]);
      return out;
    },
    style(line) {
      const gone = (this.over.excluded || []).includes(line.id) || !line.used;
      return { color: line.flagged ? FLAG : GREY, width: line.flagged ? 1.6 : 1.1, opacity: gone ? 0.5 : 0.85, type: gone ? "dotted" : "solid" };
    },
    comma(text) { return text.replace(".", this.info.words.comma); },
    names(dim) { return dim === "t" ? `${this.info.words.time} (s)` : `${"xyz"[dim]} (mm)`; },
    draw() {
      this.drawn = true;
      const grids = this.grids(), n = grids.length, side = this.current.view === "path";
      const series = [];
      grids.forEach((grid, g) => {
        const shared = { type: "line", xAxisIndex: g, yAxisIndex: g, showSymbol: false, silent: true, animation: false, hoverAnimation: false };
        this.lines.forEach((line, i) => {
          const set = line[this.current.mode], count = set.clock.length;
          series.push({ ...shared, id: `d${g}-${i}`, z: 2, lineStyle: this.style(line),
            data: this.flat(set, grid, count, Math.max(1, Math.floor(count / DRAWN))) });
        });
        const shapes = this.info.shapes[`${grid.x}${grid.y}`] || {};
        series.push(this.polygons(`tube${g}`, g, this.current.tube && this.current.mode === "aligned" ? shapes.tube || [] : [], { fill: "rgba(31,95,168,0.16)" }, 1));
        series.push(this.polygons(`parts${g}`, g, this.current.components && (side || this.current.mode === "aligned") ? shapes.components || [] : [],
          { fill: "rgba(31,95,168,0.10)", stroke: BLUE, lineWidth: 1.2 }, 3));
        const learned = side || this.current.mode === "aligned" ? this.flat(this.path, grid, this.path.clock.length) : [];
        const places = this.lines.filter((line) => line.place).map((line) => [line[this.current.mode], line.place[this.current.mode]]);
        series.push({ xAxisIndex: g, yAxisIndex: g, id: `places${g}`, type: "scatter", silent: true, animation: false, z: 7, symbol: "triangle", symbolSize: 15,
          itemStyle: { color: FLAG, borderColor: "white", borderWidth: 1.5 }, data: places.map(([set, i]) => [this.value(set, i, grid.x), this.value(set, i, grid.y)]) });
        series.push({ ...shared, id: `learned${g}`, z: 5, lineStyle: { color: BLUE, width: 3 }, data: learned });
      });
      this.chart.setOption({ animation: false,
        grid: this.areas(),
        xAxis: grids.map((grid, g) => ({ type: "value", gridIndex: g, name: side || g === n - 1 ? this.names(grid.x) : "", nameLocation: "middle", nameGap: 26, scale: true,
          axisLine: { onZero: false, lineStyle: { color: SOFT } }, splitLine: { lineStyle: { color: "#e8ecf0" } }, axisLabel: { showMinLabel: false, showMaxLabel: false, formatter: (value) => this.comma(String(value)) } })),
        yAxis: grids.map((grid, g) => ({ type: "value", gridIndex: g, name: this.names(grid.y), nameLocation: "middle", nameGap: 40, scale: true,
          axisLine: { onZero: false, show: true, lineStyle: { color: SOFT } }, splitLine: { lineStyle: { color: "#e8ecf0" } }, axisLabel: { showMinLabel: false, showMaxLabel: false, formatter: (value) => this.comma(String(value)) } })),
        dataZoom: this.zooms(this.current.tool === "move"),
        series }, { notMerge: true });
      this.fit();
      this.$el.dataset.view = `${this.current.view}-${this.current.mode}`;
    },
    zooms(pan) {
      return this.grids().flatMap((_, g) => [
        { id: `zx${g}`, type: "inside", xAxisIndex: g, filterMode: "none", moveOnMouseMove: pan, preventDefaultMouseMove: pan, zoomOnMouseWheel: true },
        { id: `zy${g}`, type: "inside", yAxisIndex: g, filterMode: "none", moveOnMouseMove: pan, preventDefaultMouseMove: pan, zoomOnMouseWheel: true }]);
    },
    polygons(id, g, shapes, style, z) {
      return { id, type: "custom", xAxisIndex: g, yAxisIndex: g, silent: true, animation: false, z, clip: true, encode: { x: -1, y: -1 },
        data: shapes.map((_, k) => [k]),
        renderItem: (params, api) => ({ type: "polygon", silent: true, style, shape: { points: shapes[params.dataIndex].map((p) => api.coord(p)) } }) };
    },
    // Where each grid lies on the page, in px.
    areas() {
      const n = this.grids().length, width = this.chart.getWidth(), height = this.chart.getHeight();
      return this.grids().map((_, g) => this.current.view === "path"
        ? { left: 58 + (g * (width - 10)) / n, top: 14, width: (width - 10) / n - 74, height: height - 58 }
        : { left: 58, top: 14 + (g * (height - 60)) / n, width: width - 74, height: (height - 60) / n - 22 });
    },
    arrange() {
      if (!this.drawn) return;
      this.chart.setOption({ grid: this.areas() });
      this.fit();
    },
    drawOver() {
      if (!this.drawn) return;
      const canvas = this.$refs.over, ratio = window.devicePixelRatio || 1, wide = this.chart.getWidth(), high = this.chart.getHeight();
      if (canvas.width !== Math.round(wide * ratio) || canvas.height !== Math.round(high * ratio)) Object.assign(canvas, { width: Math.round(wide * ratio), height: Math.round(high * ratio) });
      const c = canvas.getContext("2d"), areas = this.areas(), aligned = this.current.view === "path" || this.current.mode === "aligned";
      c.setTransform(ratio, 0, 0, ratio, 0, 0);
      c.clearRect(0, 0, wide, high);
      this.grids().forEach((grid, g) => {
        const { left, top, width, height } = areas[g], { ox, sx, oy, sy } = this.scale(g);
        const at = (set, i) => [ox + sx * this.value(set, i, grid.x), oy + sy * this.value(set, i, grid.y)];
        const line = (set, colour, thick, dash, step = 1) => {
          c.beginPath(); c.strokeStyle = colour; c.lineWidth = thick; c.setLineDash(dash); c.lineJoin = "round";
          let pen = false;
          for (let i = 0; i < set.clock.length; i += step) {
            const [x, y] = at(set, i);
            if (pen) c.lineTo(x, y); else c.moveTo(x, y);
            pen = isFinite(x) && isFinite(y);
          }
          c.stroke(); c.setLineDash([]);
        };
        c.save(); c.beginPath(); c.rect(left, top, width, height); c.clip();
        const held = this.lines.find((one) => one.id === this.over.highlight)?.[this.current.mode];
        if (held) line(held, "#111827", 2.5, [], Math.max(1, Math.floor(held.clock.length / DRAWN)));
        if (aligned) for (const [key, colour, thick, dash] of LINES) if (this.over[key]) line(this.over[key], colour, thick, dash);
        c.beginPath(); c.strokeStyle = RED; c.lineWidth = 2.6; c.lineCap = "butt";
        for (const [i, indices] of Object.entries(this.over.struck || {})) for (const k of indices) {
          const [x, y] = at(this.set(Number(i)), k);
          c.moveTo(x - CROSS, y - CROSS); c.lineTo(x + CROSS, y + CROSS); c.moveTo(x - CROSS, y + CROSS); c.lineTo(x + CROSS, y - CROSS);
        }
        c.stroke();
        if (this.anchor) { c.beginPath(); c.lineWidth = 2; c.arc(...at(this.set(this.anchor.line), this.anchor.index), 7.5, 0, 7); c.stroke(); }
        c.restore();
      });
    },
    set(line) { return line < 0 ? this.path : this.lines[line][this.current.mode]; },
    // Equal scales on both axes of a path view: a millimetre is a millimetre. The zoom stays what it was.
    fit() {
      if (!this.drawn || this.current.view !== "path") return;
      const grids = this.grids(), { width, height } = this.areas()[0];
      if (width < 10 || height < 10) return;
      const xAxis = [], yAxis = [];
      grids.forEach((one, g) => {
        const low = [Infinity, Infinity], high = [-Infinity, -Infinity];
        const see = (set) => { for (let i = 0; i < set.clock.length; i++) [one.x, one.y].forEach((dim, k) => {
          const v = this.value(set, i, dim); if (v < low[k]) low[k] = v; if (v > high[k]) high[k] = v; }); };
        this.lines.forEach((line) => see(line[this.current.mode])); see(this.path);
        const scale = 1.08 * Math.max((high[0] - low[0]) / width, (high[1] - low[1]) / height, 1e-6);
        const middle = [(low[0] + high[0]) / 2, (low[1] + high[1]) / 2];
        xAxis.push({ min: middle[0] - (scale * width) / 2, max: middle[0] + (scale * width) / 2 });
        yAxis.push({ min: middle[1] - (scale * height) / 2, max: middle[1] + (scale * height) / 2 });
      });
      this.chart.setOption({ xAxis, yAxis });
      this.drawOver();
    },
    gridAt(x, y) { return this.grids().findIndex((_, g) => this.chart.containPixel({ gridIndex: g }, [x, y])); },
    scale(g) {
      const a = this.chart.convertToPixel({ gridIndex: g }, [0, 0]), b = this.chart.convertToPixel({ gridIndex: g }, [1, 1]);
      return { ox: a[0], sx: b[0] - a[0], oy: a[1], sy: b[1] - a[1] };
    },
    *pickable() {
      if (this.current.target === "all") { yield [-1, this.path]; return; }
      const gone = this.over.excluded || [];
      for (let i = 0; i < this.lines.length; i++) if (!gone.includes(this.lines[i].id)) yield [i, this.lines[i][this.current.mode]];
    },
    nearest(x, y, reach = REACH) {
      const g = this.gridAt(x, y);
      if (g < 0) return null;
      const grid = this.grids()[g], { ox, sx, oy, sy } = this.scale(g);
      let best = null, least = reach * reach;
      for (const [line, set] of this.pickable()) for (let i = 0; i < set.clock.length; i++) {
        const dx = ox + sx * this.value(set, i, grid.x) - x, dy = oy + sy * this.value(set, i, grid.y) - y, away = dx * dx + dy * dy;
        if (away < least) { least = away; best = { line, index: i }; }
      }
      return best;
    },
    pick(x, y, shift, reach) {
      const found = this.nearest(x, y, reach);
      if (!found) return;
      const stretch = (shift || this.current.tool === "stretch") && this.anchor && this.anchor.line === found.line;
      if (this.current.tool === "stretch" && !stretch) { this.anchor = found; this.drawOver(); return; }
      const from = stretch ? Math.min(this.anchor.index, found.index) : found.index, to = stretch ? Math.max(this.anchor.index, found.index) : found.index;
      this.anchor = stretch ? null : found;
      this.strike([{ line: found.line, from, to }]);
    },
    // What is struck is decided elsewhere; until the answer comes, what was picked shows as if it were all.
    strike(ranges) {
      const struck = Object.fromEntries(Object.entries(this.over.struck || {}).map(([line, indices]) => [line, new Set(indices)]));
      const picked = ranges.flatMap(({ line, from, to }) => [...Array(to - from + 1).keys()].map((k) => [line, from + k]));
      const back = picked.every(([line, k]) => struck[line]?.has(k));
      for (const [line, k] of picked) if (back) struck[line].delete(k); else (struck[line] ??= new Set()).add(k);
      this.over = { ...this.over, struck };
      this.drawOver();
      this.count("marked");
      this.$emit("strike", { ranges, mode: this.current.mode });
    },
    boxed(a, b) {
      const g = this.gridAt(...a);
      if (g < 0) return;
      const grid = this.grids()[g], { ox, sx, oy, sy } = this.scale(g), ranges = [];
      const [left, right] = [Math.min(a[0], b[0]), Math.max(a[0], b[0])], [top, bottom] = [Math.min(a[1], b[1]), Math.max(a[1], b[1])];
      for (const [line, set] of this.pickable()) {
        let from = -1;
        for (let i = 0; i <= set.clock.length; i++) {
          const x = i < set.clock.length ? ox + sx * this.value(set, i, grid.x) : NaN, y = i < set.clock.length ? oy + sy * this.value(set, i, grid.y) : NaN;
          const inside = x >= left && x <= right && y >= top && y <= bottom;
          if (inside && from < 0) from = i;
          if (!inside && from >= 0) { ranges.push({ line, from, to: i - 1 }); from = -1; }
        }
      }
      if (ranges.length) this.strike(ranges);
    },
    listen() {
      const zr = this.chart.getZr();
      let start = null, several = false;
      const box = this.$refs.box, chart = this.$refs.chart;
      // two fingers zoom: whatever the first one had begun is not meant
      const count = (e) => { several = e.touches.length > 1 || (several && e.type !== "touchstart"); if (several) { start = null; box.style.display = "none"; } };
      for (const name of ["touchstart", "touchmove"]) chart.addEventListener(name, count, { capture: true, passive: true });
      // the browser scrolls the page from here on: the chart goes with the finger, which seems to stay where it was
      chart.addEventListener("pointercancel", () => { start = null; box.style.display = "none"; });
      chart.addEventListener("contextmenu", (e) => e.preventDefault());
      zr.on("mousedown", (e) => { start = several ? null : [e.offsetX, e.offsetY]; });
      zr.on("mousemove", (e) => {
        if (start && this.current.tool === "box") {
          Object.assign(box.style, { display: "block", left: `${Math.min(start[0], e.offsetX)}px`, top: `${Math.min(start[1], e.offsetY)}px`,
            width: `${Math.abs(e.offsetX - start[0])}px`, height: `${Math.abs(e.offsetY - start[1])}px` });
        } else if (!this.waiting) {
          this.waiting = true;
          requestAnimationFrame(() => { this.waiting = false; this.hover(e.offsetX, e.offsetY); });
        }
      });
      zr.on("mouseup", (e) => {
        const from = start;
        start = null;
        box.style.display = "none";
        if (!from || this.current.tool === "move") return;
        const moved = Math.hypot(e.offsetX - from[0], e.offsetY - from[1]);
        if (this.current.tool === "box" && moved > 4) this.boxed(from, [e.offsetX, e.offsetY]);
        else if (moved <= (finger(e) ? 12 : 6)) this.pick(e.offsetX, e.offsetY, e.event?.shiftKey, finger(e) ? FINGER : REACH);
      });
      zr.on("globalout", () => { this.$refs.tip.style.display = "none"; });
    },
    hover(x, y) {
      const tip = this.$refs.tip, found = this.info ? this.nearest(x, y) : null;
      if (!found) { tip.style.display = "none"; return; }
      const set = this.set(found.line), values = [...Array(this.d).keys()].map((k) => `${"xyz"[k]} ${this.comma(this.value(set, found.index, k).toFixed(1))}`).join("  ");
      tip.textContent = `${found.line < 0 ? this.info.words.learned : this.lines[found.line].id} · ${values} mm · ${this.comma(set.clock[found.index].toFixed(2))} s`;
      Object.assign(tip.style, { display: "block", left: `${Math.min(x + 14, this.chart.getWidth() - 230)}px`, top: `${Math.max(y - 30, 0)}px` });
    },
    // For tests and benchmarks: where on the screen a sample of a line is.
    where(line, index, g = 0) {
      const set = this.set(line), grid = this.grids()[g], box = this.$refs.chart.getBoundingClientRect();
      const [x, y] = this.chart.convertToPixel({ gridIndex: g }, [this.value(set, index, grid.x), this.value(set, index, grid.y)]);
      return [box.left + x, box.top + y];
    },
  },
};
