// Who uses the page: logging in with a token where the server asks for one, and out again. The token itself is kept
// nowhere: the server answers it with a cookie that no script can read.
import type { ComponentChildren } from "preact";
import { useEffect, useState } from "preact/hooks";
import { ApiError, call, get, loggedOut, post } from "./api";
import { enumText } from "./format";
import { Fault } from "./parts";

interface Caller {
  name: string;
  role: string;
  has_token: boolean; // false: the server has no tokens, and there is nothing to log in to
}

function LogIn({ done }: { done: (caller: Caller) => void }) {
  const [token, setToken] = useState("");
  const [fault, setFault] = useState("");
  const [busy, setBusy] = useState(false);
  const submit = async (event: Event) => {
    event.preventDefault();
    setBusy(true);
    setFault("");
    try {
      done(await post<Caller>("/v1/session", { token: token.trim() }));
    } catch (error) {
      setFault(String((error as Error).message));
      setBusy(false);
    }
  };
  return (
    <main id="main" tabIndex={-1}>
      <form class="log-in" aria-label="Log in" onSubmit={(event) => void submit(event)}>
        <h1>Log in</h1>
        <div class="field">
          <label for="token">Token</label>
          <input
            id="token" type="password" autocomplete="off" spellcheck={false} required value={token}
            onInput={(event) => setToken(event.currentTarget.value)}
          />
          <span class="note">It begins with orb_; whoever runs the server makes one: orbituned token create</span>
        </div>
        {fault && <Fault>{fault}</Fault>}
        <div class="actions">
          <button type="submit" class="primary" disabled={busy || token.trim() === ""}>Log in</button>
        </div>
      </form>
    </main>
  );
}

// What is inside is there only while the server takes this browser for somebody. who: for the page's head.
export function Session({ children }: { children: (who: ComponentChildren) => ComponentChildren }) {
  const [caller, setCaller] = useState<Caller | "asking" | "nobody">("asking");
  const ask = () => {
    get<Caller>("/v1/caller").then(setCaller, (error: unknown) => {
      // A server that does not answer is no reason to log in; the views tell, and try again.
      const nobody = error instanceof ApiError && error.code === 401;
      setCaller(nobody ? "nobody" : { name: "", role: "", has_token: false });
    });
  };
  useEffect(() => {
    ask();
    const out = () => setCaller("nobody");
    addEventListener(loggedOut, out);
    return () => removeEventListener(loggedOut, out);
  }, []);
  if (caller === "asking") return null;
  if (caller === "nobody") return <LogIn done={setCaller} />;
  const logOut = async () => {
    await call<null>("DELETE", "/v1/session").catch(() => null);
    ask();
  };
  return (
    <>
      {children(
        caller.has_token && (
          <span class="who" data-testid="who">
            {caller.name}, {enumText(caller.role, "ROLE_")}
            <button type="button" class="quiet" onClick={() => void logOut()}>Log out</button>
          </span>
        ),
      )}
    </>
  );
}
