/** What a report says that a result is worth, of any report that was ever stored. */
const VALUES = ["good", "doubtful", "keep_source"];
const EARLIER = "An earlier version made this result. It said only that the asset was not the better one, which is not to say that the result is good.";
/**
 * Return the verdict of a report; null if it has none.
 *
 * A value that this version does not know is doubtful: `keep_result`, of earlier versions, said no more.
 */
export function readVerdict(report) {
    const stored = member(report, "verdict");
    if (typeof stored !== "object" || stored === null)
        return null;
    const value = String(member(stored, "value"));
    const known = VALUES.includes(value);
    const reasons = sentences(stored, "reasons");
    return {
        value: known ? value : "doubtful",
        reasons: known || reasons.length ? reasons : [EARLIER],
        advice: sentences(stored, "advice"),
    };
}
function sentences(stored, name) {
    const found = member(stored, name);
    return Array.isArray(found) ? found.map(String) : [];
}
function member(value, name) {
    return typeof value === "object" && value !== null ? value[name] : undefined;
}
