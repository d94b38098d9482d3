// `orbitune watch JOB`.
#include <memory>

#include "client/cli/commands.h"
#include "client/cli/errors.h"
#include "client/cli/interrupt.h"
#include "client/cli/job_report.h"
#include "client/cli/live_display.h"
#include "client/cli/parse.h"
#include "client/cli/session.h"
#include "client/cli/watch_sinks.h"
#include "client/cli/watch_stream.h"

namespace orbitune::cli {
namespace {

// Tells how to go on watching.
void PrintInterrupted(const Session& session, const WatchStream& stream, const std::string& job, bool live) {
  session.err() << "orbitune: " << job << " goes on; watch it again with: orbitune" << session.ServerFlag() << " watch "
                << job;
  if (!live && stream.last_seq() > 0) session.err() << " --from " << stream.last_seq();
  session.err() << std::endl;
}

}  // namespace

int RunWatch(Session& session, const WatchOptions& options) {
  const bool live = session.terminal().width && !session.json() && !options.every;
  WatchStream::Options watch;
  watch.job = ResourceName("jobs", options.job);
  watch.resume_after_seq = options.from.value_or(live ? -1 : 0);
  watch.delivery = live ? v1::DELIVERY_LATEST : v1::DELIVERY_EVERY;
  watch.reconnect_s = options.reconnect_s;

  std::unique_ptr<WatchSink> sink;
  if (live) {
    sink = std::make_unique<LiveDisplay>(session.terminal());
  } else {
    sink = std::make_unique<LineSink>(session.json(), session.out(), session.err());
  }
  Interrupt interrupt;
  WatchStream stream(session, watch, interrupt, *sink);
  const grpc::Status status = stream.Run();
  sink.reset();  // the live line is finished before anything else is printed
  if (!status.ok() && interrupt.requested()) {
    PrintInterrupted(session, stream, watch.job, live);
    return kExitInterrupted;
  }
  if (!status.ok()) return session.Fail(status);
  if (!session.json()) PrintJobSummary(stream.job(), session.out());
  return stream.job().state() == v1::JOB_STATE_SUCCEEDED ? kExitOk : kExitUnsuccessful;
}

}  // namespace orbitune::cli
