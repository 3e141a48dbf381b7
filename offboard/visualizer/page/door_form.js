// What a person says of a door: its number, its room's name. The same number as was read confirms it; both empty take back
// what was said. The recorder keeps it (offboard/operate/door_sender.py); what counts comes back with the points of interest.

const form = () => document.getElementById("door-form");

export class DoorForm {
  constructor(orders) {
    this.orders = orders;
    this.poi = null;
    form().onsubmit = (event) => {
      event.preventDefault();
      this.#send();
    };
  }

  // What is being typed stays while more is learnt of the same door
  show(poi) {
    const other = this.poi?.poi_id !== poi.poi_id;
    this.poi = poi;
    form().hidden = !this.orders.allowed;
    if (!other && form().contains(document.activeElement)) return;
    form().elements.number.value = poi.number;
    form().elements.room_name.value = poi.room_name;
  }

  #send() {
    const { poi_id, x_m, y_m } = this.poi;
    const { number, room_name } = form().elements;
    this.orders.give({ order: "door", poi_id, x_m, y_m, number: number.value.trim(), room_name: room_name.value.trim() });
    document.getElementById("door-save").focus();
  }
}
