/** What a report says that a result is worth, of any report that was ever stored. */

/** `keep_source`: the asset was better as it was. */
export type VerdictValue = "good" | "doubtful" | "keep_source";

/** What a result is worth, by a run's own checks: why, and what may help, each in sentences. */
export interface Verdict {
  value: VerdictValue;
  reasons: string[];
  advice: string[];
}

const VALUES: readonly string[] = ["good", "doubtful", "keep_source"];

const EARLIER = "An earlier version made this result. It said only that the asset was not the better one, which is not to say that the result is good.";

/**
 * Return the verdict of a report; null if it has none.
 *
 * A value that this version does not know is doubtful: `keep_result`, of earlier versions, said no more.
 */
export function readVerdict(report: unknown): Verdict | null {
  const stored = member(report, "verdict");
  if (typeof stored !== "object" || stored === null) return null;
  const value = String(member(stored, "value"));
  const known = VALUES.includes(value);
  const reasons = sentences(stored, "reasons");
  return {
    value: known ? (value as VerdictValue) : "doubtful",
    reasons: known || reasons.length ? reasons : [EARLIER],
    advice: sentences(stored, "advice"),
  };
}

function sentences(stored: unknown, name: string): string[] {
  const found = member(stored, name);
  return Array.isArray(found) ? found.map(String) : [];
}

function member(value: unknown, name: string): unknown {
  return typeof value === "object" && value !== null ? (value as Record<string, unknown>)[name] : undefined;
}
