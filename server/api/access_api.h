// AccessService in protobuf, without a transport.
#pragma once

#include "orbitune/v1/audit.pb.h"
#include "server/access/access.h"
#include "server/api/methods.h"

namespace orbitune {

v1::Role ToProto(Role role);

// Thread-safe.
class AccessApi {
 public:
  // access: outlives this; nullptr: there is no audit log.
  explicit AccessApi(Access* access) : access_(access) {}

  void AddTo(MethodTable& methods);

 private:
  absl::Status GetCaller(const v1::GetCallerRequest& request, v1::Caller* out, const CallContext& context);
  absl::Status ListAuditEntries(const v1::ListAuditEntriesRequest& request, v1::ListAuditEntriesResponse* out);

  Access* const access_;
};

}  // namespace orbitune
