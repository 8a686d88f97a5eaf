// @ts-check
/** A new job that begins with a word that was taught. */

/**
 * Begin with the model and the prompt of the address, and forget them: what is typed next is the draft.
 *
 * @param {{model?: string, prompt?: string}} wanted
 * @param {import("./settings-panel.js").SettingsPanel} settings
 * @param {import("./prompt-field.js").PromptField} prompt
 */
export function beginWith(wanted, settings, prompt) {
  if (!wanted.model) return;
  settings.choose(wanted.model);
  prompt.set(wanted.prompt ?? "");
  history.replaceState(null, "", "#/");
}
