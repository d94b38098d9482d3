// GainService in protobuf, without a transport. The methods are as the proto says.
#pragma once

#include "google/protobuf/empty.pb.h"
#include "orbitune/v1/gains.pb.h"
#include "server/api/methods.h"
#include "server/service/gain_use_cases.h"

namespace orbitune {

// Thread-safe. Methods may block.
class GainApi {
 public:
  // use_cases: outlives this.
  explicit GainApi(GainUseCases& use_cases) : use_cases_(use_cases) {}

  void AddTo(MethodTable& methods);

 private:
  absl::Status QueryGains(const v1::QueryGainsRequest& request, v1::QueryGainsResponse* out,
                          const Cancelled& cancelled);
  absl::Status GetGainSet(const v1::GetGainSetRequest& request, v1::GainSet* out);
  absl::Status ListGainSets(const v1::ListGainSetsRequest& request, v1::ListGainSetsResponse* out);
  absl::Status ImportGainSets(const v1::ImportGainSetsRequest& request, v1::ImportGainSetsResponse* out,
                              const Cancelled& cancelled);
  absl::Status DeleteGainSet(const v1::DeleteGainSetRequest& request, google::protobuf::Empty* out);

  GainUseCases& use_cases_;
};

}  // namespace orbitune
