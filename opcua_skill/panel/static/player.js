// Commanded and measured path of a run, from above and from the side, in space, and over time; play, pause, scrub, and
// live while the arm moves. The view in space is drawn on a plain canvas: a panel PC without a graphics card is enough.
// The arm in it is drawn from its links, as the server tells them, and from the joints of the record, or of now.
import { echarts } from "nicegui-echart";
import { links, seen } from "panel-links";

const BLUE = "#1f5fa8", ORANGE = "#b45309", VIOLET = "#7a1fa2", SOFT = "#9aa9b8", INK = "#5b6b7b", LINK = "#dde4eb", RIM = "#8a99a8";
const PATHS = [[0, 1], [0, 2]], AXES = ["x (mm)", "y (mm)", "z (mm)"];

export default {
  template: `<div style="display:flex;flex-direction:column;gap:8px;width:100%" :class="{ 'replay-frame': length }">
    <div v-if="length" class="replay-banner" data-mark="replay" role="status"><strong>{{ labels.replay }}</strong> <span>{{ title }}</span>
      <button type="button" class="player-button replay-end" data-mark="end-replay" @click="begin(); $emit('closed', {})">{{ labels.end }}</button></div>
    <div style="position:relative;width:100%" :style="{height: height}">
      <div ref="chart" role="img" :aria-label="(length ? labels.replay + ' ' + title + ': ' : '') + labels.chart" style="position:absolute;inset:0" :style="{visibility: view === 'space' ? 'hidden' : 'visible'}"></div>
      <canvas ref="space" role="img" :aria-label="labels.chart" style="position:absolute;inset:0;width:100%;height:100%;touch-action:none;cursor:grab" v-show="view === 'space'" data-mark="space"></canvas>
      <button type="button" v-show="view === 'space'" @click="whole = !whole; near = 1; drawSpace()" class="player-button" style="position:absolute;right:0;top:0;padding:0 12px" data-mark="whole">{{ whole ? labels.near : labels.arm }}</button></div>
    <div v-show="length" class="replay-controls">
      <button ref="play" data-mark="play" type="button" @click="toggle" class="player-button" :disabled="!length">{{ playing ? labels.hold : labels.play }}</button>
      <input ref="scrub" type="range" min="0" :max="length" step="any" v-model.number="at" @input="playing = false; mark()" class="player-scrub" :disabled="!length" :aria-label="labels.time">
      <select v-model.number="speed" class="player-speed" :aria-label="labels.speed"><option :value="0.25">×¼</option><option :value="1">×1</option><option :value="4">×4</option></select>
      <span style="font-variant-numeric:tabular-nums;min-width:112px;text-align:right">{{ figure(at, 2) }} / {{ figure(length, 2) }} s</span>
    </div>
    <div style="font-size:13px;min-height:18px" :style="{color: length ? '#7a1fa2' : '#5b6b7b'}" ref="told">{{ told }}</div></div>`,
  props: { labels: Object, height: String },
  data() { return { playing: false, at: 0, length: 0, speed: 1, told: "", title: "", view: "paths", whole: true }; },
  async mounted() {
    await new Promise((done) => setTimeout(done, 0));
    this.run = null;
    this.planned = [];
    this.trail = [];
    this.now = null;
    this.azimuth = -0.6; this.height3 = 0.45; this.near = 1;
    this.chain = null; this.joints = [];
    this.chart = echarts.init(this.$refs.chart);
    this.observer = new ResizeObserver(() => { this.chart.resize(); this.fit(); this.drawSpace(); });
    this.observer.observe(this.$refs.chart);
    this.key = (e) => {
      const typing = ["INPUT", "TEXTAREA", "SELECT", "BUTTON"].includes(document.activeElement?.tagName) && document.activeElement !== this.$refs.scrub && document.activeElement !== this.$refs.play;
      if (e.code === "Space" && !typing && this.length) { e.preventDefault(); this.$refs.play.blur(); this.toggle(); }
    };
    document.addEventListener("keydown", this.key);
    this.listen();
    this.draw();
    this.$emit("drawn", {});
  },
  beforeUnmount() {
    this.playing = false;
    document.removeEventListener("keydown", this.key);
    this.observer?.disconnect();
    this.chart?.dispose();
  },
  methods: {
    // chain: origins, axes and capsules of the links, mm
    arm(chain) { this.chain = chain; this.drawSpace(); },
    // joints now, rad
    pose(joints) { this.joints = joints; if (!this.run) this.drawSpace(); },
    // run: pauses [[from, until] s], times [s], commanded and measured [[x, y, z] mm], joints: packed, rad, or empty
    load(run) {
      this.run = run; this.trail = []; this.title = run.title; this.measured = run.measured_word; this.playing = false;
      const bytes = Uint8Array.from(atob(run.joints), (c) => c.charCodeAt(0));
      run.joints = new Float32Array(bytes.buffer);
      run.dof = run.joints.length / Math.max(run.times.length, 1);
      this.length = run.times.length ? run.times[run.times.length - 1] : 0;
      this.at = 0;
      this.draw();
      this.$el.dataset.loaded = run.job;
    },
    plan(points) { this.planned = points; if (!this.run) this.draw(); },
    look(view) { this.view = view; this.$el.dataset.view = view; this.$nextTick(() => this.draw()); }, // what is hidden has no size
    begin() { delete this.$el.dataset.loaded; this.run = null; this.title = ""; this.playing = false; this.length = 0; this.at = 0; this.trail = []; this.told = ""; this.now = null; this.draw(); },
    live(point) { if (this.run) return; this.trail.push(point); this.update(point); this.fit(); },
    pause() { this.playing = false; },
    toggle() {
      if (!this.length) return;
      if (this.at >= this.length) this.at = 0;
      this.playing = !this.playing;
      let last = performance.now();
      const step = (now) => {
        if (!this.playing) return;
        this.at = Math.min(this.length, this.at + (this.speed * (now - last)) / 1000);
        last = now;
        this.mark();
        if (this.at >= this.length) this.playing = false; else requestAnimationFrame(step);
      };
      requestAnimationFrame(step);
    },
    index() {
      const t = this.run.times;
      let low = 0, high = t.length - 1;
      while (low < high) { const mid = (low + high + 1) >> 1; if (t[mid] <= this.at) low = mid; else high = mid - 1; }
      return low;
    },
    // where and for how long the run stood still
    stood() {
      return (this.run?.pauses || []).map(([from, until]) => ({ seconds: `❚❚ ${this.figure(until - from, 1)} s`, at: this.run.commanded[this.run.times.findIndex((t) => t >= from)] }));
    },
    tick(value) { return String(value).replace(".", this.labels.comma); },
    figure(value, digits) { return value.toFixed(digits).replace(".", this.labels.comma); },
    away(i) { const m = this.run.measured[i], c = this.run.commanded[i]; return Math.hypot(m[0] - c[0], m[1] - c[1], m[2] - c[2]); },
    mark() {
      if (!this.run || !this.run.times.length) return;
      const i = this.index(), m = this.run.measured[i];
      const stands = this.run.pauses.some(([from, until]) => this.at >= from && this.at < until) ? ` · ❚❚ ${this.labels.paused}` : "";
      this.told = `${this.labels.replay} · ${this.measured}${stands} · x ${this.figure(m[0], 1)}  y ${this.figure(m[1], 1)}  z ${this.figure(m[2], 1)} mm · ${this.labels.away} ${this.figure(this.away(i), 3)} mm`;
      this.update(m);
    },
    update(point) {
      this.now = point;
      if (this.view === "space") { this.drawSpace(); return; }
      if (this.view === "time") {
        if (this.run) this.chart.setOption({ series: [0, 1, 2, 3].map((g) => ({ id: `now${g}`, markLine: { data: [{ xAxis: this.at }] } })) });
        return;
      }
      this.chart.setOption({ series: PATHS.flatMap(([x, y], g) => [
        { id: `tip${g}`, data: point ? [[point[x], point[y]]] : [] },
        { id: `trail${g}`, data: this.run ? [] : this.trail.map((p) => [p[x], p[y]]) }]) });
    },
    points() { return this.run ? [...this.run.commanded, ...this.run.measured] : [...this.planned, ...this.trail]; },
    axis(name, g, vertical) {
      return { type: "value", gridIndex: g, name, nameLocation: "middle", nameGap: vertical ? 42 : 26, scale: true, axisLine: { onZero: false, show: true, lineStyle: { color: INK } },
        splitLine: { lineStyle: { color: "#e8ecf0" } }, splitNumber: this.chart.getWidth() < 500 ? 2 : 5, axisLabel: { showMinLabel: false, showMaxLabel: false, hideOverlap: true, formatter: this.tick } };
    },
    line(id, g, data, lineStyle, z) { return { id: `${id}${g}`, type: "line", xAxisIndex: g, yAxisIndex: g, showSymbol: false, silent: true, animation: false, z, lineStyle, data }; },
    draw() {
      if (this.view === "space") this.drawSpace(); else if (this.view === "time") this.drawTime(); else this.drawPaths();
      if (this.run) this.mark();
    },
    drawPaths() {
      const cut = (points, g) => points.map((p) => [p[PATHS[g][0]], p[PATHS[g][1]]]);
      this.chart.setOption({ animation: false,
        grid: [{}, {}],
        xAxis: PATHS.map(([x], g) => this.axis(AXES[x], g, false)),
        yAxis: PATHS.map(([, y], g) => this.axis(AXES[y], g, true)),
        series: PATHS.flatMap(([x, y], g) => [
          this.line("planned", g, this.run ? [] : cut(this.planned, g), { color: SOFT, width: 2, type: "dashed" }, 1),
          this.line("commanded", g, this.run ? cut(this.run.commanded, g) : [], { color: BLUE, width: 4, opacity: 0.45 }, 2),
          this.line("measured", g, this.run ? cut(this.run.measured, g) : [], { color: VIOLET, width: 1.5 }, 3),
          // single readings, not a line: between two of them nobody looked, and a line would seem to cut corners
          { id: `trail${g}`, type: "scatter", xAxisIndex: g, yAxisIndex: g, silent: true, animation: false, z: 3, symbolSize: 5, itemStyle: { color: ORANGE }, data: this.run ? [] : cut(this.trail, g) },
          { id: `pauses${g}`, type: "scatter", xAxisIndex: g, yAxisIndex: g, silent: true, animation: false, z: 4, symbol: "rect", symbolSize: 9, itemStyle: { color: VIOLET },
            data: this.stood().map(({ seconds, at }) => ({ value: [at[x], at[y]], label: { show: true, position: "right", formatter: seconds, color: VIOLET, fontSize: 13 } })) },
          { id: `tip${g}`, type: "scatter", xAxisIndex: g, yAxisIndex: g, silent: true, animation: false, z: 9, symbol: this.run ? "emptyDiamond" : "circle", symbolSize: this.run ? 18 : 15, itemStyle: this.run ? { color: VIOLET, borderColor: VIOLET, borderWidth: 3 } : { color: ORANGE, borderColor: "white", borderWidth: 2 }, data: [] }]) }, { notMerge: true });
      this.fit();
    },
    drawTime() {
      const run = this.run, rows = [0, 1, 2, 3], height = this.chart.getHeight();
      const stood = { silent: true, itemStyle: { color: VIOLET, opacity: 0.14 }, label: { color: VIOLET, fontSize: 13, position: "insideTop" } };
      const bands = (g) => (run?.pauses || []).map(([from, until], k) => [{ xAxis: from, name: g ? "" : this.stood()[k].seconds }, { xAxis: until }]);
      const over = (points, k) => run ? run.times.map((t, i) => [t, points[i][k]]) : [];
      this.chart.setOption({ animation: false,
        grid: rows.map((g) => ({ left: 64, right: 16, top: 8 + (g * (height - 44)) / 4, height: (height - 44) / 4 - 16 })),
        xAxis: rows.map((g) => ({ ...this.axis(g === 3 ? `${this.labels.time} (s)` : "", g, false), min: 0, max: run ? this.length : 1, axisLabel: { show: g === 3, showMaxLabel: false, formatter: this.tick } })),
        yAxis: rows.map((g) => ({ ...this.axis(g === 3 ? this.labels.error : AXES[g], g, true), splitNumber: 3, scale: g < 3 })),
        series: rows.flatMap((g) => [
          ...(g < 3 ? [this.line("commanded", g, over(run?.commanded, g), { color: BLUE, width: 4, opacity: 0.45 }, 2), this.line("measured", g, over(run?.measured, g), { color: VIOLET, width: 1.5 }, 3)]
            : [this.line("error", g, run ? run.times.map((t, i) => [t, this.away(i)]) : [], { color: VIOLET, width: 1.5 }, 3)]),
          { ...this.line("stood", g, [], {}, 1), markArea: { ...stood, data: bands(g) } },
          { ...this.line("now", g, [], {}, 9), markLine: { silent: true, symbol: "none", animation: false, label: { show: false }, lineStyle: { color: INK, type: "solid" }, data: run ? [{ xAxis: this.at }] : [] } }]) }, { notMerge: true });
    },
    // The view in space: turned about the vertical and tipped, with equal scales, seen from far away.
    listen() {
      const canvas = this.$refs.space, down = new Map();
      const apart = () => { const [a, b] = [...down.values()]; return Math.hypot(a[0] - b[0], a[1] - b[1]); };
      canvas.addEventListener("pointerdown", (e) => { down.set(e.pointerId, [e.clientX, e.clientY]); canvas.setPointerCapture(e.pointerId); });
      canvas.addEventListener("pointermove", (e) => {
        const from = down.get(e.pointerId);
        if (!from) return;
        const before = down.size === 2 ? apart() : 0;
        down.set(e.pointerId, [e.clientX, e.clientY]);
        if (down.size === 2) this.zoom(apart() / Math.max(before, 1));
        else if (down.size === 1) {
          this.azimuth -= (e.clientX - from[0]) / 150;
          this.height3 = Math.max(-0.1, Math.min(1.57, this.height3 + (e.clientY - from[1]) / 150));
          this.$el.dataset.turned = this.azimuth.toFixed(3);
          this.drawSpace();
        }
      });
      for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (e) => down.delete(e.pointerId));
      canvas.addEventListener("wheel", (e) => { e.preventDefault(); this.zoom(Math.exp(-e.deltaY / 500)); }, { passive: false });
    },
    zoom(by) { this.near = Math.max(0.5, Math.min(20, this.near * by)); this.$el.dataset.zoomed = this.near.toFixed(2); this.drawSpace(); },
    // The joints to draw: those of the record where it is played, else those of now; none: the record has none.
    posture() {
      if (!this.run) return this.joints;
      return this.run.dof ? this.run.joints.subarray(this.index() * this.run.dof, (this.index() + 1) * this.run.dof) : [];
    },
    drawSpace() {
      const canvas = this.$refs.space;
      if (this.view !== "space" || !canvas) return;
      const wide = canvas.clientWidth, high = canvas.clientHeight, ratio = window.devicePixelRatio || 1;
      if (!wide || !high) return;
      canvas.width = Math.round(wide * ratio); canvas.height = Math.round(high * ratio);
      const c = canvas.getContext("2d"), joints = this.posture();
      c.setTransform(ratio, 0, 0, ratio, 0, 0);
      c.clearRect(0, 0, wide, high);
      const arm = this.chain && joints.length ? links(this.chain, joints) : null;
      const path = this.points(), whole = [[0, 0, 0], ...path, ...(arm ? arm.capsules.flatMap((one) => [one.start, one.end]) : [])];
      const around = this.whole || !path.length ? whole : path, span = Math.max(100, ...whole.map((p) => Math.max(Math.abs(p[0]), Math.abs(p[1]))));
      const floor = Math.ceil(span / 100) * 100, low = [Infinity, Infinity], up = [-Infinity, -Infinity];
      const look = (p) => seen(p, this.azimuth, this.height3);
      for (const p of around) look(p).slice(0, 2).forEach((v, k) => { low[k] = Math.min(low[k], v); up[k] = Math.max(up[k], v); });
      const room = this.whole ? 160 : 0, scale = this.near * Math.min((wide - 60) / Math.max(up[0] - low[0] + room, 10), (high - 60) / Math.max(up[1] - low[1] + room, 10));
      const px = (p) => { const [a, b] = look(p); return [wide / 2 + scale * (a - (low[0] + up[0]) / 2), high / 2 - scale * (b - (low[1] + up[1]) / 2)]; };
      const stroke = (list, colour, width, dash = []) => {
        c.beginPath(); c.strokeStyle = colour; c.lineWidth = width; c.setLineDash(dash); c.lineJoin = "round"; c.lineCap = "round";
        list.forEach((p, i) => { if (i) c.lineTo(...px(p)); else c.moveTo(...px(p)); });
        c.stroke(); c.setLineDash([]);
      };
      for (let g = -floor; g <= floor; g += 100) { stroke([[g, -floor, 0], [g, floor, 0]], "#e3e9ef", 1); stroke([[-floor, g, 0], [floor, g, 0]], "#e3e9ef", 1); }
      c.font = "13px Roboto, sans-serif"; c.fillStyle = INK;
      c.fillText(this.labels.turn, 8, high - 8);
      [[[100, 0, 0], "x"], [[0, 100, 0], "y"], [[0, 0, 100], "z"]].forEach(([tip, name]) => { stroke([[0, 0, 0], tip], INK, 2); c.fillText(name, ...px(tip).map((v, k) => v + (k ? -4 : 4))); });
      if (arm) {
        // the farthest link first; its rim is darker, so that links in front of each other are told apart
        const far = (one) => look(one.start)[2] + look(one.end)[2];
        for (const { start, end, radius } of arm.capsules.sort((one, other) => far(other) - far(one))) {
          stroke([start, end], RIM, 2 * radius * scale + 1.5);
          stroke([start, end], LINK, Math.max(2 * radius * scale - 1.5, 1));
        }
        stroke(arm.origins, "rgba(29,39,51,0.55)", 2);
        for (const p of arm.turning) { const [a, b] = px(p); c.beginPath(); c.arc(a, b, 3.5, 0, 7); c.fillStyle = "#1d2733"; c.fill(); }
      }
      this.$el.dataset.links = arm ? arm.capsules.length : 0;
      if (this.run) { stroke(this.run.commanded, "rgba(31,95,168,0.45)", 4); stroke(this.run.measured, VIOLET, 1.5); } else stroke(this.planned, SOFT, 2, [6, 5]);
      c.fillStyle = ORANGE;
      if (!this.run) for (const p of this.trail) { const [a, b] = px(p); c.beginPath(); c.arc(a, b, 2.5, 0, 7); c.fill(); }
      if (this.now) {
        // the nozzle's tip, and how high it is above the base's plane
        const [x, y, z] = this.now;
        stroke([[x, y, 0], [x, y, z]], SOFT, 1, [3, 4]);
        const [a, b] = px(this.now);
        c.beginPath(); c.arc(a, b, 6, 0, 7);
        if (this.run) { c.lineWidth = 3; c.strokeStyle = VIOLET; c.stroke(); } else { c.fillStyle = ORANGE; c.fill(); c.lineWidth = 2; c.strokeStyle = "white"; c.stroke(); }
      }
    },
    // For tests: where the chain of links puts the nozzle's tip, and where the record has it, mm.
    tips() { const { origins } = links(this.chain, this.posture()); return [origins[origins.length - 1], this.now]; },
    fit() {
      if (this.view !== "paths") { if (this.view === "time") this.drawTime(); return; }
      const points = this.points(), all = this.chart.getWidth(), height = this.chart.getHeight() - 58, width = all / 2 - 78;
      if (width < 10 || height < 10) return;
      const axes = PATHS.map(([x, y], g) => {
        const low = [Infinity, Infinity], high = [-Infinity, -Infinity];
        for (const p of points) [x, y].forEach((k, i) => { if (p[k] < low[i]) low[i] = p[k]; if (p[k] > high[i]) high[i] = p[k]; });
        if (!points.length) { low.fill(0); high.fill(100); }
        const scale = 1.1 * Math.max((high[0] - low[0]) / width, (high[1] - low[1]) / height, 0.02);
        const middle = [(low[0] + high[0]) / 2, (low[1] + high[1]) / 2];
        return { grid: { left: 60 + (g * all) / 2, width, top: 14, bottom: 44 },
          x: { min: middle[0] - (scale * width) / 2, max: middle[0] + (scale * width) / 2 }, y: { min: middle[1] - (scale * height) / 2, max: middle[1] + (scale * height) / 2 } };
      });
      this.chart.setOption({ grid: axes.map((a) => a.grid), xAxis: axes.map((a) => a.x), yAxis: axes.map((a) => a.y) });
    },
  },
};
