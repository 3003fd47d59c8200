// Commanded and measured path of a run, from above and from the side; play, pause, scrub, and live while the arm moves.
import { echarts } from "nicegui-echart";

const BLUE = "#1f5fa8", ORANGE = "#b45309", SOFT = "#9aa9b8";
const GRIDS = [[0, 1], [0, 2]];

export default {
  template: `<div style="display:flex;flex-direction:column;gap:8px;width:100%">
    <div ref="chart" :style="{width: '100%', height: height}"></div>
    <div style="display:flex;gap:10px;align-items:center;flex-wrap:nowrap">
      <button ref="play" type="button" @click="toggle" style="min-width:52px;height:38px;border:1px solid #1f5fa8;border-radius:4px;color:#1f5fa8;font-size:16px" :disabled="!length">{{ playing ? '❚❚' : '▶' }}</button>
      <input ref="scrub" type="range" min="0" :max="length" step="any" v-model.number="at" @input="playing = false; mark()" style="flex:1;height:30px" :disabled="!length" :aria-label="labels.time">
      <select v-model.number="speed" style="height:38px;border:1px solid #d5dce4;border-radius:4px;padding:0 6px" :aria-label="labels.speed"><option :value="0.25">×¼</option><option :value="1">×1</option><option :value="4">×4</option></select>
      <span style="font-variant-numeric:tabular-nums;min-width:112px;text-align:right">{{ at.toFixed(2) }} / {{ length.toFixed(2) }} s</span>
    </div>
    <div style="font-size:13px;color:#5b6b7b;min-height:18px" ref="told">{{ told }}</div></div>`,
  props: { labels: Object, height: String },
  data() { return { playing: false, at: 0, length: 0, speed: 1, told: "" }; },
  async mounted() {
    await new Promise((done) => setTimeout(done, 0));
    this.run = null;
    this.planned = [];
    this.trail = [];
    this.chart = echarts.init(this.$refs.chart);
    this.observer = new ResizeObserver(() => { this.chart.resize(); this.fit(); });
    this.observer.observe(this.$refs.chart);
    this.key = (e) => {
      const typing = ["INPUT", "TEXTAREA", "SELECT", "BUTTON"].includes(document.activeElement?.tagName) && document.activeElement !== this.$refs.scrub && document.activeElement !== this.$refs.play;
      if (e.code === "Space" && !typing && this.length) { e.preventDefault(); this.$refs.play.blur(); this.toggle(); }
    };
    document.addEventListener("keydown", this.key);
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
    // run: times [s], commanded and measured [[x, y, z] mm]
    load(run) {
      this.run = run; this.trail = [];
      this.length = run.times.length ? run.times[run.times.length - 1] : 0;
      this.at = 0;
      this.draw();
      this.$el.dataset.loaded = run.job;
      if (run.play) { this.playing = false; this.toggle(); }
    },
    plan(points) { this.planned = points; if (!this.run) this.draw(); },
    begin() { this.run = null; this.playing = false; this.length = 0; this.at = 0; this.trail = []; this.told = ""; this.draw(); },
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
    mark() {
      if (!this.run || !this.run.times.length) return;
      const i = this.index(), m = this.run.measured[i], c = this.run.commanded[i];
      const away = Math.hypot(m[0] - c[0], m[1] - c[1], m[2] - c[2]);
      this.told = `x ${m[0].toFixed(1)}  y ${m[1].toFixed(1)}  z ${m[2].toFixed(1)} mm · ${this.labels.away} ${away.toFixed(3)} mm`;
      this.update(m);
    },
    update(point) {
      this.chart.setOption({ series: GRIDS.flatMap(([x, y], g) => [
        { id: `tip${g}`, data: point ? [[point[x], point[y]]] : [] },
        { id: `trail${g}`, data: this.run ? [] : this.trail.map((p) => [p[x], p[y]]) }]) });
    },
    points() { return this.run ? [...this.run.commanded, ...this.run.measured] : [...this.planned, ...this.trail]; },
    draw() {
      const line = (id, g, data, lineStyle, z) => ({ id: `${id}${g}`, type: "line", xAxisIndex: g, yAxisIndex: g, showSymbol: false, silent: true, animation: false, z, lineStyle, data });
      const cut = (points, g) => points.map((p) => [p[GRIDS[g][0]], p[GRIDS[g][1]]]);
      const names = ["x (mm)", "y (mm)", "z (mm)"];
      this.chart.setOption({ animation: false,
        grid: [{}, {}],
        xAxis: GRIDS.map(([x], g) => ({ type: "value", gridIndex: g, name: names[x], nameLocation: "middle", nameGap: 26, scale: true, axisLine: { onZero: false, lineStyle: { color: "#5b6b7b" } }, splitLine: { lineStyle: { color: "#e8ecf0" } }, axisLabel: { showMinLabel: false, showMaxLabel: false } })),
        yAxis: GRIDS.map(([, y], g) => ({ type: "value", gridIndex: g, name: names[y], nameLocation: "middle", nameGap: 42, scale: true, axisLine: { onZero: false, show: true, lineStyle: { color: "#5b6b7b" } }, splitLine: { lineStyle: { color: "#e8ecf0" } }, axisLabel: { showMinLabel: false, showMaxLabel: false } })),
        series: [0, 1].flatMap((g) => [
          line("planned", g, this.run ? [] : cut(this.planned, g), { color: SOFT, width: 2, type: "dashed" }, 1),
          line("commanded", g, this.run ? cut(this.run.commanded, g) : [], { color: BLUE, width: 4, opacity: 0.45 }, 2),
          line("measured", g, this.run ? cut(this.run.measured, g) : [], { color: ORANGE, width: 1.5 }, 3),
          // single readings, not a line: between two of them nobody looked, and a line would seem to cut corners
          { id: `trail${g}`, type: "scatter", xAxisIndex: g, yAxisIndex: g, silent: true, animation: false, z: 3, symbolSize: 5, itemStyle: { color: ORANGE }, data: this.run ? [] : cut(this.trail, g) },
          { id: `tip${g}`, type: "scatter", xAxisIndex: g, yAxisIndex: g, silent: true, animation: false, z: 9, symbolSize: 15, itemStyle: { color: ORANGE, borderColor: "white", borderWidth: 2 }, data: [] }]) }, { notMerge: true });
      this.fit();
      if (this.run) this.mark();
    },
    fit() {
      const points = this.points(), all = this.chart.getWidth(), height = this.chart.getHeight() - 58, width = all / 2 - 78;
      if (width < 10 || height < 10) return;
      const axes = GRIDS.map(([x, y], g) => {
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
