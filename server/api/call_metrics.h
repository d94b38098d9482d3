// How long calls took, by method and by what came of them.
#pragma once

#include <map>
#include <memory>
#include <mutex>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "core/base/histogram.h"
#include "google/protobuf/descriptor.h"

namespace orbitune {

// Thread-safe.
class CallMetrics {
 public:
  struct Row {
    const google::protobuf::MethodDescriptor* method;
    absl::StatusCode code;
    Histogram::Snapshot seconds;
  };

  void Observe(const google::protobuf::MethodDescriptor* method, absl::StatusCode code, double seconds);

  // By method and code, those that there were.
  std::vector<Row> Read() const;

 private:
  using Key = std::pair<const google::protobuf::MethodDescriptor*, absl::StatusCode>;

  mutable std::mutex mutex_;
  std::map<Key, std::unique_ptr<Histogram>> rows_;  // guarded by mutex_
};

}  // namespace orbitune
