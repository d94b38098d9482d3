// Provenance and verification, from the domain's to orbitune.v1.
#pragma once

#include "orbitune/v1/tuning.pb.h"
#include "server/jobs/verify.h"

namespace orbitune {

// job: with provenance.
void ProvenanceToProto(const JobRecord& job, v1::Provenance* out);

void ToProto(const VerifyProgress& progress, v1::VerifyProgress* out);
void ToProto(const Verification& verification, v1::Verification* out);

}  // namespace orbitune
