// Figures of the robot beside the map: battery, speed, time left, how well it is received; and a module's ten minutes.

const $ = (id) => document.getElementById(id);
const SVG = "http://www.w3.org/2000/svg";
const [WIDTH, HEIGHT] = [78, 16]; // of a curve, in CSS pixels
const MEMORY_KB = 1024;
const GAP_S = 1; // a longer silence is said beside the share

function set(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

// In steps that nobody takes for exact
function roughly(seconds, size) {
  if (size < 90) return [Math.max(10, 10 * Math.round(seconds / 10)), "s"];
  const minutes = seconds / 60;
  return [minutes < 10 ? Math.max(1, Math.round(minutes)) : 5 * Math.round(minutes / 5), "min"];
}

// While it explores nobody knows how much is left; nine in ten times the truth was within this factor of what it seems
const UNKNOWN = 4;

function timeLeft(seconds, exploring) {
  if (!exploring) return `≈ ${roughly(seconds, seconds).join(" ")}`;
  const most = UNKNOWN * seconds;
  const [low] = roughly(seconds / UNKNOWN, most), [high, unit] = roughly(most, most);
  return `${low} to ${high} ${unit}`;
}

export function showVitals({ vitals, state, clock, mission }) {
  const live = state === "live";
  const now = (value, text) => (live && value !== null && value !== undefined ? text(value) : "–");
  set($("left"), now(vitals?.left_s, (seconds) => timeLeft(seconds, mission?.stage === "explore")));
  set($("speed-now"), now(vitals?.speed_m_s, (speed) => `${speed.toFixed(2)} m/s`));
  const volts = vitals?.battery_v ?? null;
  set($("battery"), volts === null ? "–" : `${volts.toFixed(1)} V${vitals.battery_low ? " low" : ""}`);
  $("battery").dataset.low = Boolean(vitals?.battery_low);
  set($("reception"), now(vitals?.received_share, (share) => reception(share, vitals.longest_gap_s)));
  $("reception").title = clock.ahead === null ? "" : `This page's server answers in ${Math.round(2000 * clock.doubt)} ms.`;
}

function reception(share, gap) {
  const percent = share === 1 ? "100" : Math.min(99, Math.floor(100 * share));
  return gap > GAP_S ? `${percent} %, gap ${gap.toFixed(gap < 10 ? 1 : 0)} s` : `${percent} %`;
}

// Memory and processor of one module as two curves and words; nothing before there are two samples
export function showHealth(element, health, sample_s) {
  const { memory_kb: memory, cpu_percent: cpu } = health ?? { memory_kb: [], cpu_percent: [] };
  element.hidden = memory.length < 2;
  if (element.hidden) return;
  const minutes = Math.max(1, Math.round((memory.length * sample_s) / 60));
  const large = Math.max(...memory) >= 10 * MEMORY_KB;
  const span = (values, unit) => {
    const [low, high] = [Math.min(...values), Math.max(...values)].map((value) => Math.round(value));
    return `${low === high ? low : `${low} to ${high}`} ${unit}`;
  };
  const size = span(large ? memory.map((kb) => kb / MEMORY_KB) : memory, large ? "MB" : "kB");
  const words = `${size}, ${span(cpu, "% cpu")} in ${minutes} min`;
  if (element.dataset.words === words + memory.length) return;
  element.dataset.words = words + memory.length;
  element.replaceChildren(curves(memory, cpu), words);
}

function curves(memory, cpu) {
  const svg = document.createElementNS(SVG, "svg");
  svg.setAttribute("viewBox", `0 0 ${WIDTH} ${HEIGHT}`);
  svg.setAttribute("aria-hidden", "true");
  for (const [name, values] of [["memory", memory], ["cpu", cpu]]) {
    const top = Math.max(...values, 1);
    const at = (k) => `${((WIDTH * k) / (values.length - 1)).toFixed(1)},${(HEIGHT - 1.5 - (HEIGHT - 3) * (values[k] / top)).toFixed(1)}`;
    const curve = document.createElementNS(SVG, "polyline");
    curve.setAttribute("class", name);
    curve.setAttribute("points", values.map((_, k) => at(k)).join(" "));
    svg.append(curve);
  }
  return svg;
}
