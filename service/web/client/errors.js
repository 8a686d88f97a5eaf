/** The one class of errors. */
/**
 * Something went wrong: the service refused a request, a job failed, or nobody answered.
 *
 * `code` is stable: those of the service, and of this client `unavailable` (no answer), `wait_timeout` (the job goes on),
 * `job_canceled` and `job_expired` (how a job ended that was waited for), `checksum_unavailable` (no SHA-256 here), and
 * `upload_elsewhere` (the service takes uploads at another host, which `directUploads` forbids).
 */
export class MeshdeformError extends Error {
    name = "MeshdeformError";
    code;
    /** The HTTP status; 0 where the service did not answer. */
    status;
    /** What is wrong in a few words, the same for all errors with this code. */
    title;
    /** What to do about it. */
    advice;
    /** All members of the problem document, such as `errors` or `nouns`. */
    problem;
    /** The request's id in the log of the service. */
    requestId;
    /** Seconds after which to try again, if the service says so. */
    retryAfterS;
    constructor(status, problem, retryAfterS = null, options) {
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
    get unanswered() {
        return this.status === 0 && this.code === "unavailable";
    }
}
/** Return the error that a response describes. */
export async function errorOf(response) {
    let problem = {};
    try {
        const found = await response.json();
        if (typeof found === "object" && found !== null)
            problem = found;
    }
    catch {
        // A proxy's page, perhaps: the status says enough.
    }
    return new MeshdeformError(response.status, problem, retryAfterS(response));
}
function retryAfterS(response) {
    const text = response.headers.get("Retry-After");
    if (!text)
        return null;
    const seconds = Number(text);
    if (Number.isFinite(seconds))
        return Math.max(seconds, 0);
    const at = Date.parse(text);
    return Number.isNaN(at) ? null : Math.max((at - Date.now()) / 1000, 0);
}
