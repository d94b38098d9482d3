#include "server/api/gains.h"

#include "absl/strings/str_cat.h"
#include "server/api/answer.h"
#include "server/convert/gains.h"

namespace orbitune {

void GainApi::AddTo(MethodTable& methods) {
  const std::string service = "orbitune.v1.GainService.";
  // What takes milliseconds must not wait behind what may take seconds.
  methods.Add(
      service + "QueryGains", this, &GainApi::QueryGains,
      +[](const v1::QueryGainsRequest& r) { return r.has_refine() ? Work::kEpisode : Work::kQuery; });
  methods.Add(service + "GetGainSet", Work::kRead, this, &GainApi::GetGainSet);
  methods.Add(service + "ListGainSets", Work::kRead, this, &GainApi::ListGainSets);
  methods.Add(service + "ImportGainSets", Work::kWrite, this, &GainApi::ImportGainSets);
  methods.Add(service + "DeleteGainSet", Work::kWrite, this, &GainApi::DeleteGainSet);
}

absl::Status GainApi::QueryGains(const v1::QueryGainsRequest& request, v1::QueryGainsResponse* out,
                                 const Cancelled& cancelled) {
  if (cancelled()) return absl::CancelledError("nobody waits for the answer any more");
  const auto query = FromProto(request);
  return query.ok() ? Answer(use_cases_.Query(*query, cancelled), out) : query.status();
}

absl::Status GainApi::GetGainSet(const v1::GetGainSetRequest& request, v1::GainSet* out) {
  const auto id = IdFromName("gainSets", request.name(), "name");
  if (!id.ok()) return id.status();
  const auto set = use_cases_.Get(*id);
  if (set.ok()) DefinitionToProto(*set, out->mutable_scenario_definition());
  return Answer(set, out);
}

absl::Status GainApi::ListGainSets(const v1::ListGainSetsRequest& request, v1::ListGainSetsResponse* out) {
  if (!v1::GainSetView_IsValid(request.view())) {
    return InvalidField("view", "GAIN_SET_VIEW_BASIC or GAIN_SET_VIEW_FULL", request.view());
  }
  const auto page = use_cases_.List(request.page_size(), request.page_token(), request.filter());
  absl::Status status = AnswerPage(page, out, [out] { return out->add_gain_sets(); });
  if (!status.ok() || request.view() != v1::GAIN_SET_VIEW_FULL) return status;
  for (int i = 0; i < out->gain_sets_size(); ++i) {
    DefinitionToProto(page->items[static_cast<std::size_t>(i)],
                      out->mutable_gain_sets(i)->mutable_scenario_definition());
  }
  return status;
}

absl::Status GainApi::ImportGainSets(const v1::ImportGainSetsRequest& request, v1::ImportGainSetsResponse* out,
                                     const Cancelled& cancelled) {
  std::vector<ImportedGainSet> sets;
  FieldErrors errors;
  for (int i = 0; i < request.gain_sets_size(); ++i) {
    auto set = FromProto(request.gain_sets(i));
    if (set.ok()) {
      sets.push_back(*std::move(set));
    } else {
      errors.Merge(absl::StrCat("gain_sets[", i, "]"), set.status());
    }
  }
  if (!errors.empty()) return errors.ToStatus();
  const auto import = use_cases_.Import(sets, request.validate_only(), cancelled);
  if (!import.ok()) return import.status();
  for (const GainSet& set : import->sets) ToProto(set, out->add_gain_sets());
  out->set_imported(import->imported);
  return absl::OkStatus();
}

absl::Status GainApi::DeleteGainSet(const v1::DeleteGainSetRequest& request, google::protobuf::Empty*) {
  const auto id = IdFromName("gainSets", request.name(), "name");
  return id.ok() ? use_cases_.Delete(*id) : id.status();
}

}  // namespace orbitune
