import { createHmac, timingSafeEqual } from "node:crypto";
import { createServer } from "node:http";

const key = Buffer.from(process.env.WEBHOOK_SECRET.replace(/^whsec_/, ""), "base64");
const seen = new Set(); // with several processes: a table with a unique column

function isGenuine(headers, body) {
  const { "webhook-id": id, "webhook-timestamp": at, "webhook-signature": signatures = "" } = headers;
  if (!id || !(Math.abs(Date.now() / 1000 - Number(at)) < 300)) return false;
  const expected = createHmac("sha256", key).update(`${id}.${at}.`).update(body).digest();
  return signatures.split(" ").filter((each) => each.startsWith("v1,")).some((each) => {
    const given = Buffer.from(each.slice(3), "base64");
    return given.length === expected.length && timingSafeEqual(given, expected);
  });
}

createServer(async (request, response) => {
  const body = Buffer.concat(await request.toArray());
  if (!isGenuine(request.headers, body)) return response.writeHead(401).end();
  response.writeHead(204).end();
  const message = JSON.parse(body);
  const id = request.headers["webhook-id"];
  if (message.type !== "job.succeeded" || seen.has(id)) return;
  seen.add(id);
  console.log("finished", message.data.job.id, message.data.job.state);
}).listen(Number(process.env.PORT ?? 9000), "127.0.0.1");
