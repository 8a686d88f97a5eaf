const TERMINAL = new Set(["succeeded", "failed", "canceled", "expired"]);
/** Return whether nothing happens any more after this state, or after an event of this type. */
export function isTerminal(state) {
    return TERMINAL.has(state);
}
