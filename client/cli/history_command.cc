// `orbitune history JOB`: every iteration, as CSV or JSON lines.
#include "client/cli/commands.h"
#include "client/cli/csv.h"
#include "client/cli/errors.h"
#include "client/cli/files.h"
#include "client/cli/json.h"
#include "client/cli/parse.h"
#include "client/cli/session.h"

namespace orbitune::cli {
namespace {

constexpr int kIterationPage = 10000;

grpc::Status WriteHistory(const Session& session, const std::string& job, bool json, std::ostream& out) {
  v1::ListIterationsRequest request;
  request.set_parent(ResourceName("jobs", job));
  request.set_page_size(kIterationPage);
  bool first_page = true;
  do {
    v1::ListIterationsResponse response;
    const grpc::Status status = session.Call(&v1::TuningService::Stub::ListIterations, request, &response);
    if (!status.ok()) return status;
    if (first_page && !json) out << IterationCsvHeader() << '\n';
    first_page = false;
    for (const v1::Iteration& iteration : response.iterations()) {
      if (json) {
        out << JsonLine(iteration);
      } else {
        out << IterationCsvRow(iteration) << '\n';
      }
    }
    request.set_page_token(response.next_page_token());
  } while (!request.page_token().empty());
  return grpc::Status::OK;
}

}  // namespace

int RunHistory(Session& session, const HistoryOptions& options) {
  const bool json = session.json() || options.format == "json";
  if (options.output.empty() || options.output == "-") {
    const grpc::Status status = WriteHistory(session, options.job, json, session.out());
    return status.ok() ? kExitOk : session.Fail(status);
  }
  OutputFile file(options.output);
  if (!file.status().ok()) return session.Fail(file.status());
  const grpc::Status status = WriteHistory(session, options.job, json, file.stream());
  if (!status.ok()) return session.Fail(status);
  const absl::Status committed = file.Commit();
  return committed.ok() ? kExitOk : session.Fail(committed);
}

}  // namespace orbitune::cli
