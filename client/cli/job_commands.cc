// `orbitune jobs`, `show`, and the transitions `cancel`, `pause`, `resume`, `delete`.
#include <algorithm>

#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"
#include "client/cli/commands.h"
#include "client/cli/errors.h"
#include "client/cli/format.h"
#include "client/cli/job_report.h"
#include "client/cli/json.h"
#include "client/cli/parse.h"
#include "client/cli/resource_commands.h"
#include "client/cli/session.h"
#include "client/cli/submission.h"
#include "client/cli/table.h"

namespace orbitune::cli {
namespace {

using Stub = v1::TuningService::Stub;

constexpr std::int64_t kJobPage = 1000;

void AddJob(const v1::Job& job, Table& table) {
  const std::optional<double> cost = CostOf(job.latest_iteration());
  table.AddRow({job.name(), StateText(job.state()), job.scenario().empty() ? "(own)" : Printable(job.scenario()),
                absl::StrCat(job.completed_iterations(), "/", ExpectedIterations(job)), Human(cost),
                Percent(ReductionPercent(CostOf(job.initial_iteration()), cost)), UtcTime(job.create_time()),
                Printable(job.display_name())});
}

void PrintState(const Session& session, const v1::Job& job) {
  if (session.json()) {
    session.out() << JsonLine(job);
  } else {
    session.out() << job.name() << "  " << StateText(job.state()) << '\n';
  }
}

grpc::Status Apply(const Session& session, Transition transition, const std::string& name) {
  switch (transition) {
    case Transition::kCancel:
      return Change(session, &Stub::CancelJob, name, PrintState);
    case Transition::kPause:
      return Change(session, &Stub::PauseJob, name, PrintState);
    case Transition::kResume:
      return Change(session, &Stub::ResumeJob, name, PrintState);
    case Transition::kDelete:
      break;
  }
  return Delete(session, &Stub::DeleteJob, name);
}

}  // namespace

int RunJobs(Session& session, const JobsOptions& options) {
  const absl::StatusOr<std::string> filter = BuildFilter(options);
  if (!filter.ok()) return session.Fail(filter.status());
  v1::ListJobsRequest request;
  request.set_filter(*filter);
  request.set_order_by(options.order_by);
  Table table({"NAME", "STATE", "SCENARIO", ">PROGRESS", ">J", ">REDUCTION", "CREATED", "TITLE"});
  std::int64_t count = 0;
  bool more = true;
  while (more) {
    request.set_page_size(static_cast<int>(options.limit == 0 ? kJobPage : std::min(kJobPage, options.limit - count)));
    v1::ListJobsResponse response;
    const grpc::Status status = session.Call(&Stub::ListJobs, request, &response);
    if (!status.ok()) return session.Fail(status);
    for (const v1::Job& job : response.jobs()) {
      if (options.limit != 0 && count == options.limit) break;
      ++count;
      if (session.json()) {
        session.out() << JsonLine(job);
      } else {
        AddJob(job, table);
      }
    }
    request.set_page_token(response.next_page_token());
    more = !request.page_token().empty() && (options.limit == 0 || count < options.limit);
  }
  if (!session.json()) table.Print(session.out());
  return kExitOk;
}

int RunShow(Session& session, const std::string& job_name) {
  v1::GetJobRequest request;
  request.set_name(ResourceName("jobs", job_name));
  v1::Job job;
  const grpc::Status status = session.Call(&Stub::GetJob, request, &job);
  if (!status.ok()) return session.Fail(status);
  if (session.json()) {
    session.out() << JsonLine(job);
  } else {
    PrintJob(job, session.out());
  }
  return kExitOk;
}

int RunTransition(Session& session, Transition transition, const std::vector<std::string>& jobs) {
  return ForEachName(session, "jobs", jobs, [&](const std::string& name) { return Apply(session, transition, name); });
}

}  // namespace orbitune::cli
