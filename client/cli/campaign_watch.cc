// `orbitune campaign watch`: a line for each initial condition as its job ends, and the tables at the end.
#include <algorithm>
#include <memory>
#include <utility>

#include "absl/strings/str_cat.h"
#include "client/cli/campaign_commands.h"
#include "client/cli/campaign_text.h"
#include "client/cli/errors.h"
#include "client/cli/format.h"
#include "client/cli/interrupt.h"
#include "client/cli/json.h"
#include "client/cli/parse.h"
#include "client/cli/reconnect.h"
#include "client/cli/session.h"

namespace orbitune::cli {
namespace {

// A campaign's events in order, each once, over as many connections as it takes; printed as they come.
class CampaignWatch {
 public:
  // All must outlive the watch.
  CampaignWatch(const Session& session, const CampaignWatchOptions& options, Interrupt& interrupt)
      : session_(session),
        live_(session.terminal().width && !session.json()),
        interrupt_(interrupt),
        last_seq_(options.from.value_or(0)),
        reconnect_(options.reconnect_s, interrupt, [this](const std::string& note) { Note(note); }) {
    campaign_.set_name(ResourceName("campaigns", options.campaign));
  }

  // Blocks until the campaign has ended (OK), the interrupt (CANCELLED), or an error that reconnecting does not mend.
  grpc::Status Run() {
    while (true) {
      const grpc::Status status = ReadOnce();
      EraseProgress();
      if (status.ok() && Ended(campaign_.state())) return status;
      if (interrupt_.requested()) return {grpc::StatusCode::CANCELLED, "interrupted"};
      if (!IsTransportLoss(status.error_code()) || !opened_ || !reconnect_.Await(status)) {
        return status.ok() ? grpc::Status(grpc::StatusCode::UNAVAILABLE, "the stream ended before the campaign did")
                           : status;
      }
    }
  }

  // As the events so far leave it.
  const v1::Campaign& campaign() const { return campaign_; }
  std::int64_t last_seq() const { return last_seq_; }

 private:
  grpc::Status ReadOnce() {
    v1::WatchCampaignRequest request;
    request.set_name(campaign_.name());
    request.set_resume_after_seq(last_seq_);
    grpc::ClientContext context;
    const auto reader = session_.campaigns().WatchCampaign(&context, request);
    interrupt_.Attach(&context);
    v1::WatchCampaignResponse message;
    while (reader->Read(&message)) OnMessage(message);
    grpc::Status status = reader->Finish();
    interrupt_.Attach(nullptr);
    return status;
  }

  void OnMessage(const v1::WatchCampaignResponse& message) {
    reconnect_.Connected();
    if (message.has_snapshot()) {
      if (last_seq_ < 0) last_seq_ = message.seq();
      campaign_ = message.snapshot();
      if (std::exchange(opened_, true)) return;
    } else if (message.has_progress()) {
      *campaign_.mutable_progress() = message.progress();
    } else {
      if (message.seq() <= last_seq_) return;  // seen before the connection was lost
      last_seq_ = message.seq();
      Apply(message);
    }
    Print(message);
  }

  void Apply(const v1::WatchCampaignResponse& message) {
    if (!message.has_state_change()) return;
    const v1::CampaignStateChange& change = message.state_change();
    campaign_.set_state(change.state());
    if (change.state() == v1::CAMPAIGN_STATE_FAILED) campaign_.set_error_message(change.message());
    if (change.has_results()) *campaign_.mutable_results() = change.results();
    if (Ended(change.state())) *campaign_.mutable_end_time() = change.time();
  }

  void Print(const v1::WatchCampaignResponse& message) {
    if (session_.json()) {
      session_.out() << JsonLine(message) << std::flush;
      return;
    }
    if (message.has_progress()) return ShowProgress();
    EraseProgress();
    session_.out() << Line(message) << std::endl;
  }

  std::string Line(const v1::WatchCampaignResponse& message) const {
    if (message.has_member_ended()) return MemberLine(message.member_ended(), campaign_.progress());
    if (message.has_snapshot()) {
      return absl::StrCat(campaign_.name(), "  ", CampaignStateText(campaign_.state()), "  ",
                          ProgressText(campaign_.progress()));
    }
    const v1::CampaignStateChange& change = message.state_change();
    return absl::StrCat("state ", CampaignStateText(change.state()), change.message().empty() ? "" : ": ",
                        Printable(change.message()));
  }

  // One line of a terminal, in place of the last; elsewhere nothing.
  void ShowProgress() {
    if (!live_) return;
    EraseProgress();
    const std::string text = ProgressText(campaign_.progress());
    session_.out() << text.substr(0, static_cast<std::size_t>(std::max(1, session_.terminal().width() - 1)))
                   << std::flush;
    shown_ = true;
  }

  void EraseProgress() {
    if (std::exchange(shown_, false)) session_.out() << kClearLine << std::flush;
  }

  void Note(const std::string& note) {
    EraseProgress();
    session_.err() << "orbitune: " << note << std::endl;
  }

  const Session& session_;
  const bool live_;
  Interrupt& interrupt_;
  v1::Campaign campaign_;
  std::int64_t last_seq_;
  bool opened_ = false;
  bool shown_ = false;
  Reconnect reconnect_;
};

}  // namespace

int RunCampaignWatch(Session& session, const CampaignWatchOptions& options) {
  Interrupt interrupt;
  CampaignWatch watch(session, options, interrupt);
  const grpc::Status status = watch.Run();
  const std::string& name = watch.campaign().name();
  if (!status.ok() && interrupt.requested()) {
    session.err() << "orbitune: " << name << " goes on; watch it again with: orbitune" << session.ServerFlag()
                  << " campaign watch " << name << " --from " << watch.last_seq() << std::endl;
    return kExitInterrupted;
  }
  if (!status.ok()) return session.Fail(status);
  if (!session.json()) {
    // With what the progress messages may have left out.
    v1::GetCampaignRequest request;
    request.set_name(name);
    v1::Campaign campaign;
    const grpc::Status got = session.Call(&v1::CampaignService::Stub::GetCampaign, request, &campaign);
    session.out() << '\n';
    PrintCampaignSummary(got.ok() ? campaign : watch.campaign(), session.out());
  }
  return watch.campaign().state() == v1::CAMPAIGN_STATE_SUCCEEDED ? kExitOk : kExitUnsuccessful;
}

}  // namespace orbitune::cli
