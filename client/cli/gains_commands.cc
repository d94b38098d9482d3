// `orbitune gains ...`: the gain library.
#include "client/cli/gains_commands.h"

#include <algorithm>
#include <limits>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/strip.h"
#include "client/cli/errors.h"
#include "client/cli/fields.h"
#include "client/cli/files.h"
#include "client/cli/format.h"
#include "client/cli/gains_file.h"
#include "client/cli/json.h"
#include "client/cli/parse.h"
#include "client/cli/resource_commands.h"
#include "client/cli/session.h"
#include "client/cli/submission.h"
#include "client/cli/table.h"

namespace orbitune::cli {
namespace {

using Stub = v1::GainService::Stub;

std::string KindText(v1::GainSetKind kind) {
  return std::string(absl::StripPrefix(v1::GainSetKind_Name(kind), "GAIN_SET_KIND_"));
}

std::string Hours(double seconds) { return Human(seconds / 3600, 4); }

// "+" for what is certain, "-" for what is not: gains positive, domain guaranteed, V decreasing, settled.
std::string CertificateText(const v1::Certificate& c) {
  const auto sign = [](bool certain) { return certain ? "+" : "-"; };
  return absl::StrCat(sign(c.gains_positive()), sign(c.domain_guaranteed()), sign(c.lyapunov_decreasing()),
                      sign(c.settled()));
}

std::string SourceText(const v1::GainAnswer& answer) {
  switch (answer.source()) {
    case v1::CANDIDATE_SOURCE_STORED:
      return answer.gain_set();
    case v1::CANDIDATE_SOURCE_WEIGHTED_MEAN:
      return "mean of the nearest";
    case v1::CANDIDATE_SOURCE_LIBRARY_MEAN:
      return "mean of the library";
    case v1::CANDIDATE_SOURCE_INITIAL:
      return "scenario's K(1)";
    case v1::CANDIDATE_SOURCE_REFINED:
      return "refined just now";
    default:
      return "";
  }
}

std::optional<double> CostOf(const v1::Flight& flight) {
  return flight.has_cost() ? std::optional(flight.cost()) : std::nullopt;
}

void PrintAnswers(const v1::QueryGainsResponse& response, std::ostream& out) {
  Table table({">J", ">SETTLED_H", ">DELTA_V_M_S", ">PEAK_M_S2", "CERT", ">DISTANCE", "SOURCE", "K1..K5"});
  for (const v1::GainAnswer& answer : response.answers()) {
    const v1::Flight& flight = answer.flight();
    const bool settled = flight.certificate().settled();
    table.AddRow({Human(CostOf(flight)), settled ? Hours(flight.settling_time_s()) : OutcomeText(flight.outcome()),
                  Human(flight.delta_v_m_s(), 4), Human(flight.peak_acceleration_m_s2(), 3),
                  CertificateText(flight.certificate()), answer.has_distance() ? Human(answer.distance(), 3) : "-",
                  SourceText(answer), GainsText(answer.gains(), 6)});
  }
  table.Print(out);
  const v1::LibraryPosition& position = response.position();
  out << absl::StrFormat("%d of %d candidates settle; %d gain sets stored for this scenario",
                         response.candidates_settled(), response.candidates(), position.library_size());
  if (position.has_nearest_distance()) {
    out << absl::StrFormat(", the nearest at %.3g of their spread", position.nearest_distance());
    if (position.has_typical_distance()) out << absl::StrFormat(" (usual: %.3g)", position.typical_distance());
    if (position.extrapolated()) out << ": EXTRAPOLATED";
  }
  out << '\n';
  if (response.has_refinement()) {
    out << absl::StrFormat("refined for %.0f ms over %d episodes: %s\n", 1e3 * response.refinement().elapsed_s(),
                           response.refinement().episodes(), response.refinement().improved() ? "better" : "no better");
  }
  out << absl::StrFormat("k1 in %s m/s, k2..k5 in %s m/s^2\n", Human(response.velocity_unit_m_s()),
                         Human(response.acceleration_unit_m_s2()));
  if (!response.message().empty()) out << Printable(response.message()) << '\n';
}

std::string FilterOf(const GainsListOptions& options) {
  std::vector<std::string> terms;
  if (!options.filter.empty()) terms.push_back(options.filter);
  if (!options.kind.empty()) terms.push_back(absl::StrCat("kind = ", absl::AsciiStrToUpper(options.kind)));
  if (!options.scenario.empty()) {
    terms.push_back(absl::StrCat("scenario = \"", absl::StripPrefix(options.scenario, "scenarios/"), "\""));
  }
  return absl::StrJoin(terms, " AND ");
}

// Every gain set that is asked for, `visit` in order.
template <typename Visit>
grpc::Status ForEach(const Session& session, const GainsListOptions& options, v1::GainSetView view, Visit visit) {
  if (!options.name.empty()) {
    v1::GetGainSetRequest get;
    get.set_name(ResourceName("gainSets", options.name));
    v1::GainSet set;
    const grpc::Status status = session.Call(&Stub::GetGainSet, get, &set);
    if (status.ok()) visit(set);
    return status;
  }
  v1::ListGainSetsRequest request;
  request.set_filter(FilterOf(options));
  request.set_view(view);
  std::int64_t left = options.limit > 0 ? options.limit : std::numeric_limits<std::int64_t>::max();
  do {
    request.set_page_size(static_cast<int>(std::min<std::int64_t>(left, 1000)));
    v1::ListGainSetsResponse response;
    const grpc::Status status = session.Call(&Stub::ListGainSets, request, &response);
    if (!status.ok()) return status;
    for (const v1::GainSet& set : response.gain_sets()) visit(set);
    left -= response.gain_sets_size();
    request.set_page_token(response.next_page_token());
  } while (!request.page_token().empty() && left > 0);
  return grpc::Status::OK;
}

void WriteGainSets(const std::vector<v1::GainSet>& sets, const std::string& format, std::ostream& out) {
  if (format == "json") {
    out << JsonPretty(ToGainSetFile(sets)) << '\n';
  } else if (format == "c-header") {
    for (const v1::GainSet& set : sets) out << GainSetCHeader(set);
  } else {
    out << GainSetCsvHeader() << '\n';
    for (const v1::GainSet& set : sets) out << GainSetCsvRow(set) << '\n';
  }
}

// The server's "gain_sets[2]" as the place in the file.
grpc::Status InFile(const grpc::Status& status, const std::vector<ReadGainSet>& sets) {
  std::string message = status.error_message();
  for (std::size_t i = 0; i < sets.size(); ++i) {
    message = absl::StrReplaceAll(message, {{absl::StrCat("gain_sets[", i, "]."), absl::StrCat(sets[i].where, ": ")}});
    if (message.find("gain_sets[") == std::string::npos) break;
  }
  return {status.error_code(), message};
}

}  // namespace

int RunGainsQuery(Session& session, const GainsQueryOptions& options) {
  v1::QueryGainsRequest request;
  if (options.flight.scenario.empty() && options.flight.scenario_file.empty()) {
    return session.Fail(absl::InvalidArgumentError("one of --scenario and --scenario-file is required"));
  }
  if (const absl::Status status = SetFlight(options.flight, &request); !status.ok()) return session.Fail(status);
  request.set_max_candidates(options.max_candidates);
  request.set_max_answers(options.max_answers);
  if (options.refine_ms != 0) {
    // Too large a number is the server's to refuse.
    request.mutable_refine()->set_budget_ms(static_cast<std::int32_t>(
        std::clamp<std::int64_t>(options.refine_ms, -1, std::numeric_limits<std::int32_t>::max())));
  }
  v1::QueryGainsResponse response;
  const grpc::Status status = session.Call(&Stub::QueryGains, request, &response);
  if (!status.ok()) return session.Fail(status);
  if (session.json()) {
    session.out() << JsonLine(response);
  } else {
    PrintAnswers(response, session.out());
  }
  return response.settled() ? kExitOk : kExitUnsuccessful;
}

int RunGainsList(Session& session, const GainsListOptions& options) {
  Table table({"NAME", "KIND", "SCENARIO", ">J", ">SETTLED_H", ">DELTA_V_M_S", ">PEAK_M_S2", "CERT", "K1..K5",
               "CREATED", "TITLE"});
  const grpc::Status status = ForEach(session, options, v1::GAIN_SET_VIEW_BASIC, [&](const v1::GainSet& set) {
    if (session.json()) {
      session.out() << JsonLine(set);
      return;
    }
    const v1::Flight& flight = set.flight();
    table.AddRow({set.name(), KindText(set.kind()), Printable(set.scenario()), Human(CostOf(flight)),
                  Hours(flight.settling_time_s()), Human(flight.delta_v_m_s(), 4),
                  Human(flight.peak_acceleration_m_s2(), 3), CertificateText(flight.certificate()),
                  GainsText(set.gains()), UtcTime(set.create_time()), Printable(set.display_name())});
  });
  if (!status.ok()) return session.Fail(status);
  if (!session.json()) table.Print(session.out());
  return kExitOk;
}

int RunGainsShow(Session& session, const std::string& name) {
  v1::GetGainSetRequest request;
  request.set_name(ResourceName("gainSets", name));
  v1::GainSet set;
  const grpc::Status status = session.Call(&Stub::GetGainSet, request, &set);
  if (!status.ok()) return session.Fail(status);
  if (session.json()) {
    session.out() << JsonPretty(set);
  } else {
    PrintFields(set, 0, session.out());
  }
  return kExitOk;
}

int RunGainsExport(Session& session, const GainsExportOptions& options) {
  if (options.format == "c-header" && options.which.name.empty()) {
    return session.Fail(absl::InvalidArgumentError("--format c-header needs the NAME of one gain set"));
  }
  std::vector<v1::GainSet> sets;
  const grpc::Status status =
      ForEach(session, options.which, v1::GAIN_SET_VIEW_FULL, [&sets](const v1::GainSet& set) { sets.push_back(set); });
  if (!status.ok()) return session.Fail(status);
  if (options.output.empty() || options.output == "-") {
    WriteGainSets(sets, options.format, session.out());
    return kExitOk;
  }
  OutputFile file(options.output);
  if (file.status().ok()) WriteGainSets(sets, options.format, file.stream());
  const absl::Status written = file.status().ok() ? file.Commit() : file.status();
  return written.ok() ? kExitOk : session.Fail(written);
}

int RunGainsImport(Session& session, const GainsImportOptions& options) {
  auto sets = ReadGainSets(options.file);
  if (!sets.ok()) return session.Fail(sets.status());
  v1::ImportGainSetsRequest request;
  request.set_validate_only(options.validate_only);
  v1::Scenario definition;
  if (!options.scenario_file.empty()) {
    const absl::Status read = ReadJsonFile(options.scenario_file, &definition);
    if (!read.ok()) return session.Fail(read);
  }
  for (const ReadGainSet& read : *sets) {
    v1::GainSet& set = *request.add_gain_sets() = read.set;
    if (!set.has_scenario_definition() && !options.scenario_file.empty())
      *set.mutable_scenario_definition() = definition;
  }
  v1::ImportGainSetsResponse response;
  const grpc::Status status = session.Call(&Stub::ImportGainSets, request, &response);
  if (!status.ok()) return session.Fail(InFile(status, *sets));
  if (session.json()) {
    session.out() << JsonLine(response);
  } else {
    const char* const verb = options.validate_only ? "would be imported" : "imported";
    session.out() << absl::StrFormat("%d of %d gain sets %s, the others are there already\n", response.imported(),
                                     response.gain_sets_size(), verb);
  }
  return kExitOk;
}

int RunGainsDelete(Session& session, const std::vector<std::string>& names) {
  return ForEachName(session, "gainSets", names,
                     [&](const std::string& name) { return Delete(session, &Stub::DeleteGainSet, name); });
}

}  // namespace orbitune::cli
