// Where answers are computed: a worker for each channel, newest request first; without workers, the page itself.

import { engineOf } from "./engine.mjs";
import { loadKernel } from "./kernel.mjs";

const LISTEN = 30; // ms between two looks for a newer request

/** Answer one request; `report` is called for every part, `stale` says whether a newer request has come. */
async function answer(engine, request, report, stale) {
  const result = engine[request.kind](request);
  if (result === undefined || typeof result[Symbol.iterator] !== "function" || Array.isArray(result)) {
    report(result, true);
    return;
  }
  let since = performance.now();
  for (const part of result) {
    if (part) report(part, false);
    if (performance.now() - since < LISTEN) continue;
    await new Promise((resume) => setTimeout(resume)); // 4 ms at least, for a browser
    if (stale()) return;
    since = performance.now();
  }
  report(null, true);
}

/** What runs in a worker. */
export function serve(scope) {
  const engine = engineOf();
  let ready = null;
  let newest = 0;
  scope.onmessage = async ({ data }) => {
    if (data.kernel) {
      ready = loadKernel(data.kernel);
      return;
    }
    newest = data.id;
    const report = (part, last) => scope.postMessage({ id: data.id, part, last });
    try {
      await ready;
      await answer(engine, data.request, report, () => newest !== data.id);
    } catch (error) {
      scope.postMessage({ id: data.id, error: String(error.message || error), last: true });
    }
  };
}

const DEPTH = 2; // requests with a worker: it begins the next while the page draws

/**
 * A channel: ask(request) runs the newest request that was asked; what comes while the worker has enough to do waits, and only
 * the last of it. `preempt` says that a newer request ends those that run (their parts are given up between two of them).
 */
export function channel(code, kernel, receive, { preempt = false } = {}) {
  const running = new Map();
  let waiting = null;
  let id = 0;
  const arrived = ({ id: of, part, last, error }) => {
    const request = running.get(of);
    if (!request) return;
    if (error) receive({ error }, request);
    else if (part !== null) receive(part, request);
    if (!last) return;
    running.delete(of);
    if (waiting) ask(waiting);
  };
  let post;
  try {
    const url = URL.createObjectURL(new Blob([code], { type: "text/javascript" }));
    const worker = new Worker(url);
    worker.onmessage = ({ data }) => arrived(data);
    worker.onerror = () => [...running.keys()].forEach((of) => arrived({ id: of, error: "the worker stopped", last: true }));
    worker.postMessage({ kernel });
    post = (message) => worker.postMessage(message);
  } catch {
    channel.local = true;
    const scope = { postMessage: arrived };
    serve(scope);
    post = (data) => setTimeout(() => scope.onmessage({ data }));
    post({ kernel });
  }
  function ask(request) {
    if (preempt) running.clear();
    waiting = running.size < DEPTH ? null : request;
    if (waiting) return;
    running.set(++id, request);
    post({ id, request });
  }
  return ask;
}
