// Calls to the server, and its errors as the page shows them.
import type { JobEvent } from "./types";

export interface Violation {
  field: string;
  description: string;
}

export class ApiError extends Error {
  constructor(
    message: string,
    readonly code: number, // HTTP; 0: no answer
    readonly violations: Violation[] = [],
  ) {
    super(message);
  }
}

interface ErrorBody {
  error?: { message?: string; details?: { "@type"?: string; field_violations?: Violation[] }[] };
}

// Told to the window when the server wants to know who asks.
export const loggedOut = "orbitune-logged-out";

function toError(code: number, text: string): ApiError {
  let body: ErrorBody = {};
  try {
    body = JSON.parse(text) as ErrorBody;
  } catch {
    // A proxy's page, or none at all.
  }
  const details = body.error?.details ?? [];
  const violations = details.flatMap((detail) => detail.field_violations ?? []);
  return new ApiError(body.error?.message ?? `the server answered ${code}`, code, violations);
}

export async function call<T>(method: string, path: string, body?: unknown, signal?: AbortSignal): Promise<T> {
  let response: Response;
  let text: string;
  try {
    response = await fetch(path, {
      method,
      ...(body === undefined ? {} : { body: JSON.stringify(body), headers: { "Content-Type": "application/json" } }),
      ...(signal ? { signal } : {}),
    });
    text = await response.text();
  } catch (error) {
    if (error instanceof DOMException && error.name === "AbortError") throw error;
    throw new ApiError("the server does not answer", 0);
  }
  if (response.status === 401 && path !== "/v1/session") dispatchEvent(new Event(loggedOut));
  if (!response.ok) throw toError(response.status, text);
  return (text === "" ? null : JSON.parse(text)) as T;
}

export const get = <T>(path: string, signal?: AbortSignal): Promise<T> => call<T>("GET", path, undefined, signal);
export const post = <T>(path: string, body: unknown, signal?: AbortSignal): Promise<T> =>
  call<T>("POST", path, body, signal);

export function query(parameters: Record<string, string | number>): string {
  const given = Object.entries(parameters).filter(([, value]) => value !== "" && value !== 0);
  return given.length === 0 ? "" : `?${new URLSearchParams(given.map(([name, value]) => [name, String(value)]))}`;
}

export interface StreamHandlers<Event> {
  events: (batch: Event[]) => void; // once a frame at most
  connected: (connected: boolean) => void;
}

// A watch over Server-Sent Events that goes on until it is closed, or the server has nothing more to tell. The browser
// itself resumes after the last event's id; where it gives up (an answer that is no stream), this does.
export class Stream<Event extends { seq: string } = JobEvent> {
  private source: EventSource | null = null;
  private waiting: Event[] = [];
  private frame = 0;
  private timer = 0;
  private after = "-1";

  constructor(
    private readonly path: string,
    private readonly handlers: StreamHandlers<Event>,
  ) {
    this.open();
  }

  close(): void {
    this.source?.close();
    this.source = null;
    cancelAnimationFrame(this.frame);
    clearTimeout(this.timer);
  }

  private open(): void {
    const source = new EventSource(`${this.path}?resume_after_seq=${this.after}`);
    this.source = source;
    const take = (message: MessageEvent<string>) => {
      if (message.lastEventId !== "") this.after = message.lastEventId;
      this.waiting.push(JSON.parse(message.data) as Event);
      // A page that is not shown gets no frames.
      if (document.hidden) this.deliver();
      else if (this.frame === 0) this.frame = requestAnimationFrame(() => this.deliver());
    };
    for (const kind of ["snapshot", "iteration", "state_change", "gap", "member_ended", "progress"]) {
      source.addEventListener(kind, take);
    }
    source.onopen = () => this.handlers.connected(true);
    source.onerror = () => {
      if (this.source !== source) return;
      this.deliver(); // which may close this, where there was nothing more to tell
      if (this.source !== source) return;
      this.handlers.connected(false);
      // CLOSED: the browser will not try again. Why, it does not tell: perhaps the session has ended.
      if (source.readyState !== EventSource.CLOSED) return;
      get("/v1/caller").catch(() => null);
      this.timer = window.setTimeout(() => this.open(), 2000);
    };
  }

  private deliver(): void {
    cancelAnimationFrame(this.frame);
    this.frame = 0;
    const batch = this.waiting;
    this.waiting = [];
    if (batch.length > 0 && this.source) this.handlers.events(batch);
  }
}
