// The dashboard: a view for each #/path, under one row of links.
import { render } from "preact";
import { useEffect, useState } from "preact/hooks";
import { Session } from "./session";
import { CampaignView } from "./views/campaign";
import { CampaignsView, NewCampaignView } from "./views/campaigns";
import { CompareView } from "./views/compare";
import { GainsView } from "./views/gains";
import { JobView } from "./views/job";
import { JobsView } from "./views/jobs";
import { NewJobView } from "./views/new_job";

const links: [string, string][] = [
  ["#/jobs", "Jobs"],
  ["#/new", "New job"],
  ["#/compare", "Compare"],
  ["#/campaigns", "Campaigns"],
  ["#/gains", "Gains"],
];

function View({ hash }: { hash: string }) {
  const [path, search] = hash.replace(/^#\/?/, "").split("?");
  const [first, id] = (path ?? "").split("/");
  switch (first) {
    case "":
    case "jobs":
      return id ? <JobView key={id} id={id} /> : <JobsView />;
    case "new":
      return <NewJobView />;
    case "compare":
      return <CompareView ids={(new URLSearchParams(search).get("jobs") ?? "").split(",").filter(Boolean)} />;
    case "campaigns":
      if (id === "new") return <NewCampaignView />;
      return id ? <CampaignView key={id} id={id} /> : <CampaignsView />;
    case "gains":
      return <GainsView />;
    default:
      return <p class="empty">There is no such page. <a href="#/jobs">Jobs</a></p>;
  }
}

function App() {
  const [hash, setHash] = useState(location.hash);
  useEffect(() => {
    const change = () => {
      setHash(location.hash);
      scrollTo(0, 0);
    };
    addEventListener("hashchange", change);
    return () => removeEventListener("hashchange", change);
  }, []);
  const at = hash === "" || hash === "#/" ? "#/jobs" : hash;
  return (
    <>
      <a class="skip" href="#main" onClick={(e) => { e.preventDefault(); document.getElementById("main")?.focus(); }}>Skip to the content</a>
      <Session>{(who) => (<>
      <header class="top">
        <a class="brand" href="#/jobs"><img src="favicon.svg" alt="" width="22" height="22" /> Orbitune</a>
        <nav aria-label="Views">
          {links.map(([href, title]) => (
            <a key={href} href={href} aria-current={at.split("?")[0] === href || (href.length > 6 && at.startsWith(`${href}/`)) || (href === "#/jobs" && at.startsWith("#/jobs/")) ? "page" : undefined}>{title}</a>
          ))}
        </nav>
        {who}
      </header>
      <main id="main" tabIndex={-1}>
        <View hash={hash} />
      </main>
      </>)}</Session>
    </>
  );
}

render(<App />, document.getElementById("app")!);
