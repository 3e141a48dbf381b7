// The text for a point of interest. Colour is never the only sign: each state has its own symbol.

export const STATES = {
  read: { sign: "✓", text: "Read" },
  doubtful: { sign: "?", text: "Doubtful, please check" },
  unread: { sign: "–", text: "Not readable" },
};

export const stateOf = (poi) => STATES[poi.state] ?? { sign: "·", text: poi.state || "Unknown" };

// What a person said of the number, and what was read
export const judgementOf = ({ judged, number_read }) =>
  judged === "confirmed" ? "✓ Confirmed by a person" : `✓ Corrected by a person, ${number_read ? `read as ${number_read}` : "not read"}`;

export const headline = (poi) => [poi.room_name || poi.room_type, poi.number].filter(Boolean).join(" ") || poi.name || "Point of interest";

export const spoken = (poi) => [poi.name, poi.number || "without number", poi.room_name || poi.room_type].filter(Boolean).join(" ");

// In the map's own coordinates, which are those of `goto`: metres from where the robot started, ahead and to its left
export const place = ({ x_m, y_m }) => `${x_m.toFixed(2)}, ${y_m.toFixed(2)} m`;

// 7 before 12 before 101, and those without a number at the end
export function byNumber(a, b) {
  if (!a.number !== !b.number) return a.number ? -1 : 1;
  return a.number.localeCompare(b.number, undefined, { numeric: true }) || a.poi_id - b.poi_id;
}
