// What moves, on the upper canvas: plan, sonar rays, the robot and how sure it is of its place, the ruler.

const FOOTPRINT_M = 0.22;
const ROBOT_MIN_PX = 11;
const SIGMAS = 2, SIGMAS_OF_PLACE = 2.45; // 95 % of a normal distribution, and of one in two dimensions
const BEARING_M = 1.2; // as long as the sector of the heading is drawn
const ECHO_PX = 7; // of the bar at the end of a ray

// `map`: {view, model, colours, ratio, measured, layers}
export function drawAbove(context, map) {
  const { view, model, colours, ratio } = map;
  context.setTransform(1, 0, 0, 1, 0, 0);
  context.clearRect(0, 0, context.canvas.width, context.canvas.height);
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.lineCap = context.lineJoin = "round";
  for (const layer of map.layers) layer(context, view, colours);
  const live = ["live", "recorded"].includes(model.state);
  if (live) drawPlan(context, view, model, colours);
  if (model.pose) {
    const sure = live && model.pose.valid;
    if (sure) drawRays(context, view, model, colours);
    drawRobot(context, view, model.pose, colours, sure);
  }
  if (map.measured) drawRuler(context, view, map.measured, colours);
}

function line(context, ...places) {
  context.beginPath();
  for (const [x, y] of places) context.lineTo(x, y);
}

function circle(context, radius) {
  context.beginPath();
  context.arc(0, 0, radius, 0, 2 * Math.PI);
}

function drawPlan(context, view, { plan, pose }, { plan: colour, paper }) {
  if (!plan || !plan.path_m.length) return;
  const places = [...(pose ? [[pose.x_m, pose.y_m]] : []), ...plan.path_m].map(([x, y]) => view.toScreen(x, y));
  line(context, ...places);
  context.strokeStyle = colour;
  context.lineWidth = 2.5;
  context.setLineDash([7, 6]);
  context.stroke();
  context.setLineDash([]);
  context.save();
  context.translate(...places.at(-1));
  circle(context, 5);
  context.fillStyle = paper;
  context.fill();
  context.stroke();
  context.restore();
}

// To where each sonar received its echo; none where nothing answered
function drawRays(context, view, model, { sonar }) {
  const { pose, bearings } = model;
  context.strokeStyle = sonar;
  for (const [k, range] of model.freshRanges.entries()) {
    if (range === null) continue;
    const direction = pose.heading_rad + bearings[k];
    const from = view.toScreen(pose.x_m, pose.y_m);
    const to = view.toScreen(pose.x_m + range * Math.cos(direction), pose.y_m + range * Math.sin(direction));
    context.globalAlpha = 0.55;
    context.lineWidth = 1.5;
    line(context, from, to);
    context.stroke();
    const across = direction + view.angle;
    const [u, v] = [ECHO_PX * Math.sin(across), ECHO_PX * Math.cos(across)];
    context.globalAlpha = 1;
    context.lineWidth = 3;
    line(context, [to[0] - u, to[1] - v], [to[0] + u, to[1] + v]);
    context.stroke();
  }
}

// Filled where it is; an empty dashed circle where it was last known to be
function drawRobot(context, view, pose, { robot, paper }, sure) {
  const radius = Math.max(ROBOT_MIN_PX, FOOTPRINT_M * view.scale);
  context.save();
  context.translate(...view.toScreen(pose.x_m, pose.y_m));
  if (sure) drawDoubt(context, view, pose, robot);
  circle(context, radius);
  context.fillStyle = sure ? robot : paper;
  context.strokeStyle = sure ? paper : robot;
  context.lineWidth = 2;
  if (!sure) context.setLineDash([4, 4]);
  context.fill();
  context.stroke();
  context.setLineDash([]);
  context.rotate(-(pose.heading_rad + view.angle));
  line(context, ...[[0.72, 0], [-0.42, 0.5], [-0.18, 0], [-0.42, -0.5]].map(([u, v]) => [u * radius, v * radius]));
  context.closePath();
  context.fillStyle = sure ? paper : robot;
  context.fill();
  context.restore();
}

// Where the whole robot may stand, and the sector that holds its heading, in 95 of 100 cases.
function drawDoubt(context, view, { heading_rad, sd_xy_m, sd_least_m, worst_rad, sd_heading_rad }, colour) {
  context.fillStyle = context.strokeStyle = colour;
  const middle = -(heading_rad + view.angle), half = Math.min(Math.PI, SIGMAS * sd_heading_rad);
  context.beginPath();
  context.moveTo(0, 0);
  context.arc(0, 0, BEARING_M * view.scale, middle - half, middle + half);
  context.closePath();
  context.globalAlpha = 0.22;
  context.fill();
  const [longer, shorter] = [sd_xy_m, sd_least_m ?? sd_xy_m].map((sd_m) => (FOOTPRINT_M + SIGMAS_OF_PLACE * sd_m) * view.scale);
  context.beginPath();
  context.ellipse(0, 0, longer, shorter, -(worst_rad + view.angle), 0, 2 * Math.PI);
  context.globalAlpha = 0.11;
  context.fill();
  context.globalAlpha = 0.7;
  context.lineWidth = 1;
  context.stroke();
  context.globalAlpha = 1;
}

function drawRuler(context, view, { from, to }, { ink, paper }) {
  const [x0, y0] = view.toScreen(...from), [x1, y1] = view.toScreen(...to);
  for (const [colour, width] of [[paper, 5], [ink, 2]]) {
    line(context, [x0, y0], [x1, y1]);
    context.strokeStyle = colour;
    context.lineWidth = width;
    context.stroke();
  }
  for (const [x, y] of [[x0, y0], [x1, y1]]) {
    context.beginPath();
    context.arc(x, y, 4.5, 0, 2 * Math.PI);
    context.fillStyle = paper;
    context.fill();
    context.stroke();
  }
  const text = `${Math.hypot(to[0] - from[0], to[1] - from[1]).toFixed(2)} m`;
  context.font = "600 14px system-ui, sans-serif";
  const half = context.measureText(text).width / 2 + 8;
  const x = (x0 + x1) / 2, y = (y0 + y1) / 2 - 20;
  context.beginPath();
  context.roundRect(x - half, y - 13, 2 * half, 26, 6);
  context.fillStyle = ink;
  context.fill();
  context.fillStyle = paper;
  context.textAlign = "center";
  context.textBaseline = "middle";
  context.fillText(text, x, y + 0.5);
}
