// The list of recorded runs (offboard/visualizer/run_library.py): thumbnails, figures, and two of them over each other.

const $ = (id) => document.getElementById(id);
const picked = []; // names, the one that was picked first lies below
let runs = [];

function card(run) {
  const item = $("run").content.firstElementChild.cloneNode(true);
  const link = item.querySelector("a");
  link.href = `run/${encodeURIComponent(run.name)}/`;
  link.querySelector("img").src = `thumbnails/${encodeURIComponent(run.name)}.png`;
  link.querySelector("b").textContent = run.name;
  item.querySelector(".state").textContent = run.end;
  const facts = [["Recorded", run.date], ["Floor", run.floor || "–"], ["Duration", run.duration], ...Object.entries(run.figures)];
  for (const [name, value] of facts) {
    item.querySelector("dl").append(Object.assign(document.createElement("dt"), { textContent: name }));
    item.querySelector("dl").append(Object.assign(document.createElement("dd"), { textContent: value }));
  }
  item.querySelector(".damage").textContent = run.damage.join(" ");
  const pick = item.querySelector("input");
  pick.checked = picked.includes(run.name);
  pick.onchange = () => choose(run.name, pick.checked);
  pick.setAttribute("aria-label", `Compare ${run.name}`);
  return item;
}

function choose(name, on) {
  if (on) picked.push(name);
  else picked.splice(picked.indexOf(name), 1);
  if (picked.length > 2) picked.shift();
  show();
  document.querySelector(`[aria-label="Compare ${CSS.escape(name)}"]`)?.focus();
}

function show() {
  const words = $("search").value.toLowerCase().split(/\s+/).filter(Boolean);
  const fitting = runs.filter((run) => words.every((word) => `${run.name} ${run.floor} ${run.date}`.toLowerCase().includes(word)));
  $("runs").replaceChildren(...fitting.map(card));
  $("none").textContent = fitting.length ? "" : runs.length ? "None fits." : "There is no run yet.";
  $("compare").disabled = picked.length < 2;
  $("compare").textContent = picked.length < 2 ? "Compare two" : `${picked[1]} over ${picked[0]}`;
}

$("search").oninput = show;
$("compare").onclick = () => (location.href = `over/${picked.map(encodeURIComponent).join("/")}/`);
const answer = await fetch("runs.json");
const found = answer.ok ? await answer.json() : { folder: "", runs: [] };
runs = found.runs;
$("folder").textContent = found.folder;
show();
if (!answer.ok) $("none").textContent = await answer.text();
