// @ts-check
import { apiUrl } from "./run.js";
import { byId, setText } from "./html.js";

/** Pause, step, breakpoints, forced results, halt and emergency stop of a run that happens now. */
export class ControlBar {
  /** @param {{onState: (state: any) => void, selected: () => string | null, say: (text: string) => void}} options */
  constructor(options) {
    this.options = options;
    this.bar = byId("control");
    /** @type {any} */
    this.state = null;
    const commands = { "control-pause": "pause", "control-continue": "continue", "control-step": "step", "control-next": "next", "control-halt": "halt", "control-stop": "stop" };
    for (const [id, command] of Object.entries(commands)) byId(id).addEventListener("click", () => this.order({ command }));
    const force = (/** @type {string} */ status) => this.#atNode((node) => ({ command: "force", node, status }));
    byId("force-success").addEventListener("click", () => force("success"));
    byId("force-failure").addEventListener("click", () => force("failure"));
    for (const at of ["start", "end"]) {
      byId(`break-${at}`).addEventListener("click", () => this.#atNode((node) => ({ command: "break", node, at, on: !this.hasBreak(node, at) })));
    }
  }

  /** @param {string} node @param {string} at */
  hasBreak(node, at) {
    return (this.state?.breakpoints ?? []).some((/** @type {any} */ point) => point.node === node && point[at]);
  }

  #atNode(/** @type {(node: string) => object} */ command) {
    const node = this.options.selected();
    if (node === null) this.options.say("Select a node of the tree first.");
    else this.order(command(node));
  }

  /** @param {object} command */
  async order(command) {
    try {
      const response = await fetch(apiUrl("api/control"), { method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(command) });
      const said = await response.json();
      if (response.ok) this.show(said);
      else this.options.say(said.error);
    } catch {
      this.options.say("The run cannot be reached any more.");
    }
  }

  /** Shows the state of the gate. @param {any} state */
  show(state) {
    this.state = state;
    this.bar.hidden = false;
    this.bar.dataset.paused = String(state.paused);
    for (const button of this.bar.querySelectorAll("button")) button.disabled = state.over;
    byId("control-pause").disabled = state.over || state.paused;
    byId("control-continue").disabled = state.over || !state.paused;
    const why = state.over ? "The run is over." : state.ending === "stop" ? "Emergency stop." : state.paused ? `Paused: ${state.why}.` : "Running.";
    setText(byId("control-state"), why);
    byId("control-state").title = why;
    this.showNode();
    this.options.onState(state);
  }

  /** The buttons for the selected node. */
  showNode() {
    const node = this.options.selected();
    for (const at of ["start", "end"]) byId(`break-${at}`).setAttribute("aria-pressed", String(node !== null && this.hasBreak(node, at)));
    for (const id of ["force-success", "force-failure", "break-start", "break-end"]) byId(id).disabled = node === null || Boolean(this.state?.over);
  }

  /** Marks for the tree: breakpoints and results to be forced. @returns {Map<string, string>} */
  marks() {
    const marks = new Map();
    for (const point of this.state?.breakpoints ?? []) marks.set(point.node, `${point.start ? "◖" : ""}${point.end ? "◗" : ""}`);
    for (const forced of this.state?.forced ?? []) marks.set(forced.node, `${marks.get(forced.node) ?? ""}→${forced.success ? "✓" : "✗"}`);
    return marks;
  }
}
