// Small hooks that every view uses.
import { useEffect, useRef, useState } from "preact/hooks";
import { ApiError } from "./api";

export function messageOf(error: unknown): string {
  return error instanceof Error ? error.message : String(error);
}

export interface Loaded<T> {
  value: T | null;
  error: string;
  reload: () => void;
}

// Loads again whenever `key` changes, and every `everyMs` while the page is shown (0: only then).
export function useLoaded<T>(key: string, load: (signal: AbortSignal) => Promise<T>, everyMs = 0): Loaded<T> {
  const [state, setState] = useState<{ key: string; value: T | null; error: string }>({ key, value: null, error: "" });
  const [turn, setTurn] = useState(0);
  const latest = useRef(load);
  latest.current = load;
  useEffect(() => {
    const abort = new AbortController();
    let timer = 0;
    const run = async () => {
      try {
        const value = await latest.current(abort.signal);
        setState({ key, value, error: "" });
      } catch (error) {
        if (abort.signal.aborted) return;
        setState((old) => ({ key, value: old.key === key ? old.value : null, error: messageOf(error) }));
      }
      if (everyMs > 0 && !abort.signal.aborted) {
        timer = window.setTimeout(() => (document.hidden ? whenShown(run, abort.signal) : void run()), everyMs);
      }
    };
    void run();
    return () => {
      abort.abort();
      clearTimeout(timer);
    };
  }, [key, everyMs, turn]);
  return { value: state.key === key ? state.value : null, error: state.error, reload: () => setTurn((t) => t + 1) };
}

function whenShown(run: () => void, signal: AbortSignal): void {
  document.addEventListener("visibilitychange", () => run(), { once: true, signal });
}

export function isMissing(error: unknown): boolean {
  return error instanceof ApiError && error.code === 404;
}

export function useTitle(title: string): void {
  useEffect(() => {
    document.title = title === "" ? "Orbitune" : `${title} · Orbitune`;
  }, [title]);
}

// The value as it was when it last stood still for `ms`.
export function useSettled<T>(value: T, ms: number): T {
  const [settled, setSettled] = useState(value);
  useEffect(() => {
    const timer = setTimeout(() => setSettled(value), ms);
    return () => clearTimeout(timer);
  }, [value, ms]);
  return settled;
}
