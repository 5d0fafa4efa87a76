/**
 * A jsPsych plug-in (version 7 or 8): lays surfaces while a trial lasts, marks its begin and end in the daemon's
 * recording, and ends with a button, or with the key of its number, for the other hand is on the plate. jsPsych itself is
 * not here.
 *
 *   import { connect } from "../hapticd.js";
 *   import HapticdTrial from "./jspsych-hapticd.js";
 *   const plate = await connect("ws://127.0.0.1:8018/client?key=...", { ttlS: 2 });
 *   const trial = {
 *     type: HapticdTrial, plate: () => plate, // as a function, because version 7 copies objects
 *     surfaces: { left: { friction: 0.1, rectangle_mm: [40, 80], position_mm: [-30, 0] } },
 *     prompt: "Which side is more slippery?", choices: ["left", "right"],
 *   };
 *
 * Its data: `response`, `rt` (ms since the surfaces were in force), `t_begin_ns` and `t_end_ns` on the daemon's clock.
 */
export default class HapticdTrial {
  static info = {
    name: "hapticd-trial",
    version: "1.0.0",
    parameters: {
      plate: { default: undefined },
      surfaces: { default: {} },
      effects: { default: {} },
      prompt: { default: "" },
      choices: { default: ["continue"] },
      marker: { default: "trial" },
    },
    data: { response: {}, rt: {}, t_begin_ns: {}, t_end_ns: {} },
  };

  constructor(jsPsych) {
    this.jsPsych = jsPsych;
  }

  async trial(display, trial) {
    const { plate } = trial;
    for (const [name, fields] of Object.entries(trial.surfaces)) await plate.surface(name, fields);
    for (const [name, fields] of Object.entries(trial.effects)) await plate.effect(name, fields);
    const t_begin_ns = await plate.marker(`${trial.marker} begins`);
    const { response, rt } = await answered(display, trial);
    const t_end_ns = await plate.marker(`${trial.marker} ends: ${response}`.slice(0, 100));
    await plate.release();
    display.replaceChildren();
    this.jsPsych.finishTrial({ response, rt, t_begin_ns, t_end_ns });
  }
}

/** Show prompt and buttons; resolve with what was chosen and after how many milliseconds. The keys 1 .. 9 choose, too. */
function answered(display, { prompt, choices }) {
  const begun = performance.now();
  return new Promise((resolve) => {
    const choose = (choice) => {
      document.removeEventListener("keydown", pressed);
      resolve({ response: choice, rt: performance.now() - begun });
    };
    const pressed = ({ key }) => /^[1-9]$/.test(key) && choices[key - 1] !== undefined && choose(choices[key - 1]);
    document.addEventListener("keydown", pressed);
    const text = document.createElement("p");
    text.textContent = prompt;
    const buttons = choices.map((choice) => {
      const button = document.createElement("button");
      button.className = "jspsych-btn";
      button.textContent = choice;
      button.onclick = () => choose(choice);
      return button;
    });
    display.replaceChildren(text, ...buttons);
  });
}
