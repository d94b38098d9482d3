#include "server/convert/provenance.h"

#include "server/convert/job.h"

namespace orbitune {
namespace {

v1::Verdict ToProto(Verdict verdict) {
  switch (verdict) {
    case Verdict::kIdentical:
      return v1::VERDICT_IDENTICAL;
    case Verdict::kDifferent:
      return v1::VERDICT_DIFFERENT;
    case Verdict::kAltered:
      return v1::VERDICT_ALTERED;
  }
  return v1::VERDICT_UNSPECIFIED;
}

}  // namespace

void ProvenanceToProto(const JobRecord& job, v1::Provenance* out) {
  const Provenance& provenance = *job.provenance;
  out->set_seed(job.spec.scenario.search.seed);
  out->set_scenario_digest(provenance.scenario_digest);
  out->set_inputs_digest(provenance.inputs_digest);
  out->set_digest(ToHex(provenance.digest));
  out->set_iterations(job.completed_iterations());
  out->set_backfilled_iterations(provenance.backfilled);
  for (const EngineStretch& stretch : provenance.engines) {
    v1::Engine* engine = out->add_engines();
    engine->set_first_iteration(stretch.first_iteration);
    engine->set_version(stretch.engine.version);
    engine->set_simd_target(stretch.engine.simd_target);
    engine->set_fused_multiply_add(stretch.engine.fused_multiply_add);
    engine->set_libraries(stretch.engine.libraries);
  }
}

void ToProto(const VerifyProgress& progress, v1::VerifyProgress* out) {
  out->set_first_iteration(progress.first_iteration);
  out->set_last_iteration(progress.last_iteration);
  out->set_iteration(progress.iteration);
}

void ToProto(const Verification& verification, v1::Verification* out) {
  out->set_verdict(ToProto(verification.verdict));
  out->set_completed_iterations(verification.completed_iterations);
  out->set_first_iteration(verification.first_iteration);
  out->set_last_iteration(verification.last_iteration);
  if (const auto& difference = verification.first_difference) {
    out->mutable_first_difference()->set_iteration(difference->iteration);
    if (difference->stored) ToProto(*difference->stored, out->mutable_first_difference()->mutable_stored());
    if (difference->recomputed) ToProto(*difference->recomputed, out->mutable_first_difference()->mutable_recomputed());
  }
  out->set_digest(ToHex(verification.digest));
  if (verification.recorded_digest) out->set_recorded_digest(ToHex(*verification.recorded_digest));
  for (const std::string& difference : verification.engine_differences) out->add_engine_differences(difference);
  out->set_conclusion(verification.conclusion);
}

}  // namespace orbitune
