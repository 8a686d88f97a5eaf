/** The one class of errors. */

/** Members of a problem document (RFC 9457), as far as they are always there. */
export interface Problem {
  code?: string;
  title?: string;
  detail?: string;
  advice?: string;
  request_id?: string;
  [member: string]: unknown;
}

/**
 * Something went wrong: the service refused a request, a job failed, or nobody answered.
 *
 * `code` is stable: those of the service, and of this client `unavailable` (no answer), `wait_timeout` (the job goes on),
 * `job_canceled` and `job_expired` (how a job ended that was waited for), `checksum_unavailable` (no SHA-256 here), and
 * `upload_elsewhere` (the service takes uploads at another host, which `directUploads` forbids).
 */
export class MeshdeformError extends Error {
  override readonly name = "MeshdeformError";
  readonly code: string;
  /** The HTTP status; 0 where the service did not answer. */
  readonly status: number;
  /** What is wrong in a few words, the same for all errors with this code. */
  readonly title: string;
  /** What to do about it. */
  readonly advice: string;
  /** All members of the problem document, such as `errors` or `nouns`. */
  readonly problem: Problem;
  /** The request's id in the log of the service. */
  readonly requestId: string;
  /** Seconds after which to try again, if the service says so. */
  readonly retryAfterS: number | null;

  constructor(status: number, problem: Problem, retryAfterS: number | null = null, options?: ErrorOptions) {
    super(problem.detail ?? problem.title ?? `The service answered ${status}.`, options);
    this.status = status;
    this.code = problem.code ?? `http_${status}`;
    this.title = problem.title ?? this.message;
    this.advice = problem.advice ?? "";
    this.problem = problem;
    this.requestId = problem.request_id ?? "";
    this.retryAfterS = retryAfterS;
  }

  /** Whether no answer came, so that nobody knows whether the request arrived. */
  get unanswered(): boolean {
    return this.status === 0 && this.code === "unavailable";
  }
}

/** Return the error that a response describes. */
export async function errorOf(response: Response): Promise<MeshdeformError> {
  let problem: Problem = {};
  try {
    const found: unknown = await response.json();
    if (typeof found === "object" && found !== null) problem = found as Problem;
  } catch {
    // A proxy's page, perhaps: the status says enough.
  }
  return new MeshdeformError(response.status, problem, retryAfterS(response));
}

function retryAfterS(response: Response): number | null {
  const text = response.headers.get("Retry-After");
  if (!text) return null;
  const seconds = Number(text);
  if (Number.isFinite(seconds)) return Math.max(seconds, 0);
  const at = Date.parse(text);
  return Number.isNaN(at) ? null : Math.max((at - Date.now()) / 1000, 0);
}
