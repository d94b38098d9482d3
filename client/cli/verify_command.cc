// `orbitune verify JOB`.
#include <memory>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "client/cli/commands.h"
#include "client/cli/errors.h"
#include "client/cli/format.h"
#include "client/cli/interrupt.h"
#include "client/cli/json.h"
#include "client/cli/parse.h"
#include "client/cli/session.h"
#include "client/cli/table.h"

namespace orbitune::cli {
namespace {

// How far it is, on a terminal: one line, written over, and gone when there is something to say.
class ProgressOnTerminal {
 public:
  explicit ProgressOnTerminal(const Session& session) : session_(session) {}
  ~ProgressOnTerminal() {
    if (shown_) session_.err() << kClearLine << std::flush;
  }
  ProgressOnTerminal(const ProgressOnTerminal&) = delete;
  ProgressOnTerminal& operator=(const ProgressOnTerminal&) = delete;

  void Show(const v1::VerifyProgress& progress) {
    if (!session_.terminal().width || session_.json()) return;
    shown_ = true;
    session_.err() << kClearLine << "verifying: iteration " << progress.iteration() << " of "
                   << progress.last_iteration() << std::flush;
  }

 private:
  const Session& session_;
  bool shown_ = false;
};

// Until the stream's end; without a verification only where that is no OK.
grpc::Status Read(const Session& session, const v1::VerifyJobRequest& request, Interrupt& interrupt,
                  v1::Verification* out) {
  ProgressOnTerminal progress(session);
  grpc::ClientContext context;
  const std::unique_ptr<grpc::ClientReader<v1::VerifyJobResponse>> reader =
      session.tuning().VerifyJob(&context, request);
  interrupt.Attach(&context);
  v1::VerifyJobResponse message;
  bool told = false;
  while (reader->Read(&message)) {
    if (message.has_progress()) progress.Show(message.progress());
    if (!message.has_verification()) continue;
    told = true;
    *out = message.verification();
  }
  const grpc::Status status = reader->Finish();
  interrupt.Attach(nullptr);
  if (!status.ok() || told) return status;
  return {grpc::StatusCode::UNAVAILABLE, "the stream ended before the verification did"};
}

std::string CostText(const v1::Iteration& iteration) {
  return iteration.has_cost() ? RoundTrip(iteration.cost()) : "none";
}

void PrintDifference(const v1::Verification::Difference& difference, std::ostream& out) {
  const bool both = difference.has_stored() && difference.has_recomputed();
  Table table({absl::StrCat("iteration ", difference.iteration()), "stored", "recomputed", ""});
  const auto add = [&](const std::string& title, const auto& text) {
    const std::string stored = difference.has_stored() ? text(difference.stored()) : "-";
    const std::string recomputed = difference.has_recomputed() ? text(difference.recomputed()) : "-";
    table.AddRow({title, stored, recomputed, both && stored != recomputed ? "differs" : ""});
  };
  add("K1", [](const v1::Iteration& i) { return RoundTrip(i.gains().k1()); });
  add("K2", [](const v1::Iteration& i) { return RoundTrip(i.gains().k2()); });
  add("K3", [](const v1::Iteration& i) { return RoundTrip(i.gains().k3()); });
  add("K4", [](const v1::Iteration& i) { return RoundTrip(i.gains().k4()); });
  add("K5", [](const v1::Iteration& i) { return RoundTrip(i.gains().k5()); });
  add("J", CostText);
  add("settling samples", [](const v1::Iteration& i) { return absl::StrCat(i.settling_samples()); });
  add("fuel sum", [](const v1::Iteration& i) { return RoundTrip(i.fuel_sum()); });
  add("outcome", [](const v1::Iteration& i) { return OutcomeText(i.outcome()); });
  add("sigma_J", [](const v1::Iteration& i) { return RoundTrip(i.cost_std()); });
  add("pairs left out", [](const v1::Iteration& i) { return absl::StrCat(i.pairs_left_out()); });
  add("pairs not settled", [](const v1::Iteration& i) { return absl::StrCat(i.pairs_not_settled()); });
  add("episodes", [](const v1::Iteration& i) { return absl::StrCat(i.episodes()); });
  out << '\n';
  table.Print(out);
}

void Print(const std::string& job, const v1::Verification& result, std::ostream& out) {
  const std::string& recorded = result.recorded_digest();
  out << job << "  " << v1::Verdict_Name(result.verdict()).substr(8) << '\n' << Printable(result.conclusion()) << '\n';
  out << absl::StrFormat("%-16s %s\n", "digest", Printable(result.digest()));
  if (recorded != result.digest()) {
    out << absl::StrFormat("%-16s %s\n", "recorded digest", recorded.empty() ? "none" : Printable(recorded));
  }
  for (const std::string& difference : result.engine_differences()) {
    out << absl::StrFormat("%-16s %s\n", "another engine", Printable(difference));
  }
  if (result.has_first_difference()) PrintDifference(result.first_difference(), out);
}

}  // namespace

int RunVerify(Session& session, const VerifyOptions& options) {
  v1::VerifyJobRequest request;
  request.set_name(ResourceName("jobs", options.job));
  request.set_first_iteration(options.from);
  request.set_last_iteration(options.to);
  Interrupt interrupt;
  v1::Verification result;
  const grpc::Status status = Read(session, request, interrupt, &result);
  if (!status.ok() && interrupt.requested()) return kExitInterrupted;
  if (!status.ok()) return session.Fail(status);
  if (session.json()) {
    session.out() << JsonLine(result);
  } else {
    Print(request.name(), result, session.out());
  }
  return result.verdict() == v1::VERDICT_IDENTICAL ? kExitOk : kExitUnsuccessful;
}

}  // namespace orbitune::cli
