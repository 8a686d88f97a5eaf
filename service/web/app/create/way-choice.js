// @ts-check
/** How the asset becomes what is asked for: fitted to a shape, or pushed by a model that looks at pictures of it. */
import { h } from "../dom.js";
import { radioCards } from "./radio-cards.js";

const PUSHED = "pictures";
const FITTED = "shape";

export class WayChoice {
  /** @param {() => void} onChange */
  constructor(onChange) {
    this.cards = radioCards("way", [[FITTED, "By shape", ""], [PUSHED, "By pictures", ""]], FITTED, onChange);
    this.element = h("fieldset", { class: "field", hidden: true }, h("legend", { class: "field-label" }, "How"), this.cards.element);
    this.suit(0);
  }

  /** Offer the choice, if the server has both. @param {boolean} on */
  offer(on) {
    this.element.hidden = !on;
  }

  get byShape() {
    return !this.element.hidden && this.cards.value() === FITTED;
  }

  /** @param {boolean} on */
  set(on) {
    this.cards.set(on ? FITTED : PUSHED);
  }

  /** Say what the choice means. @param {number} targets How many there are; none: a prompt says what to become. */
  suit(targets) {
    const [fitted, pushed] = this.cards.texts;
    pushed.textContent = targets > 1 ? "Takes one mesh" : targets ? "Pushed little by little, until its outlines are those of the mesh" : "A model looks at it, and pushes it little by little";
    fitted.textContent = targets > 1 ? "Fitted to the nearest of the meshes, part to part" : targets ? "Fitted to the mesh, part to part" : "Fitted, part to part, to what the word stands for";
    this.cards.inputs[1].disabled = targets > 1;
    if (targets > 1) this.set(true);
  }
}
