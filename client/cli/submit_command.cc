// `orbitune submit`.
#include "absl/status/statusor.h"
#include "client/cli/commands.h"
#include "client/cli/errors.h"
#include "client/cli/fields.h"
#include "client/cli/format.h"
#include "client/cli/json.h"
#include "client/cli/session.h"
#include "client/cli/submission.h"

namespace orbitune::cli {
namespace {

void PrintCreated(const Session& session, const SubmitOptions& options, const v1::Job& job) {
  if (session.json()) {
    session.out() << JsonLine(job) << std::flush;
  } else if (options.validate_only) {
    session.out() << "The job is valid; nothing was stored. It would run with\n";
    PrintFields(job.hyperparameters(), 2, session.out());
  } else {
    session.out() << job.name() << "  " << StateText(job.state()) << '\n';
    if (!options.watch) {
      session.out() << "watch it with: orbitune" << session.ServerFlag() << " watch " << job.name() << '\n';
    }
    session.out() << std::flush;
  }
}

}  // namespace

int RunSubmit(Session& session, const SubmitOptions& options) {
  const absl::StatusOr<v1::CreateJobRequest> request = BuildCreateJobRequest(options);
  if (!request.ok()) return session.Fail(request.status());
  v1::Job job;
  const grpc::Status status = session.Call(&v1::TuningService::Stub::CreateJob, *request, &job);
  if (!status.ok()) {
    const int code = session.Fail(status);
    if (code == kExitUnreachable && !session.json() && !options.validate_only) {
      session.err() << "  whether the job was stored is unknown; this finds out without storing it twice: "
                    << "the same command with --request-id " << request->request_id() << '\n';
    }
    return code;
  }
  PrintCreated(session, options, job);
  if (!options.watch) return kExitOk;
  WatchOptions watch;
  watch.job = job.name();
  watch.reconnect_s = options.reconnect_s;
  return RunWatch(session, watch);
}

}  // namespace orbitune::cli
