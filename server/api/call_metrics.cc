#include "server/api/call_metrics.h"

namespace orbitune {

void CallMetrics::Observe(const google::protobuf::MethodDescriptor* method, absl::StatusCode code, double seconds) {
  const std::lock_guard lock(mutex_);
  std::unique_ptr<Histogram>& row = rows_[{method, code}];
  if (row == nullptr) row = std::make_unique<Histogram>(Histogram::Exponential(0.00025, 2, 16));  // up to 8 s
  row->Observe(seconds);
}

std::vector<CallMetrics::Row> CallMetrics::Read() const {
  const std::lock_guard lock(mutex_);
  std::vector<Row> rows;
  for (const auto& [key, histogram] : rows_) rows.push_back({key.first, key.second, histogram->Read()});
  return rows;
}

}  // namespace orbitune
