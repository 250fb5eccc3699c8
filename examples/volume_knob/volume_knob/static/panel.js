// A knob that turns with the volume, and a button for silence.
import { canvas, colours, make } from "../../static/dom.js";
import { button } from "../../static/controls.js";

const FROM = 0.75 * Math.PI, TURN = 1.5 * Math.PI, RADIUS = 60;  // rad, rad, px

export function panel(root, request) {
  const words = make("p", "volume"), remark = make("p", "remark");
  const mute = button("mute", async () => { remark.textContent = (await request(0)).refused ?? ""; });
  root.append(words);
  const paint = canvas(root, 2 * RADIUS + 20);
  root.append(mute, remark);

  return ({ percent }, { may_command }) => {
    words.textContent = `${Math.round(percent)} %`;
    mute.hidden = !may_command;
    paint((c, width, height) => {
      const arc = (share, colour) => {
        c.beginPath();
        c.arc(width / 2, height / 2, RADIUS, FROM, FROM + TURN * share);
        c.strokeStyle = colour;
        c.stroke();
      };
      c.lineWidth = 12;
      arc(1, colours.edge);
      arc(percent / 100, colours.force);
    });
  };
}
