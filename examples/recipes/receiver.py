import os

from fastapi import BackgroundTasks, FastAPI, Request, Response
from standardwebhooks import Webhook, WebhookVerificationError

app = FastAPI()
webhook = Webhook(os.environ["WEBHOOK_SECRET"])
seen: set[str] = set()  # with several processes: a table with a unique column


def work(job: dict) -> None:
    print("finished", job["id"], job["state"], flush=True)


@app.post("/meshdeform")
async def receive(request: Request, tasks: BackgroundTasks) -> Response:
    try:
        message = webhook.verify(await request.body(), dict(request.headers))
    except WebhookVerificationError:
        return Response(status_code=401)
    if message["type"] == "job.succeeded" and request.headers["webhook-id"] not in seen:
        seen.add(request.headers["webhook-id"])
        tasks.add_task(work, message["data"]["job"])  # after the answer, which must come within 15 seconds
    return Response(status_code=204, background=tasks)
