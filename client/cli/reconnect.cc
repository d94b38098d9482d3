#include "client/cli/reconnect.h"

#include <algorithm>

#include "absl/strings/str_cat.h"
#include "client/cli/errors.h"
#include "client/cli/format.h"

namespace orbitune::cli {
namespace {

constexpr double kFirstBackoff_s = 0.2;
constexpr double kLastBackoff_s = 2;

}  // namespace

bool IsTransportLoss(grpc::StatusCode code) {
  return code == grpc::StatusCode::OK || code == grpc::StatusCode::UNAVAILABLE || code == grpc::StatusCode::CANCELLED;
}

void Reconnect::Connected() {
  if (attempts_ > 0) note_("connected again");
  attempts_ = 0;
}

bool Reconnect::Await(const grpc::Status& loss) {
  if (for_s_ <= 0) return false;
  if (attempts_ == 0) {
    lost_at_ = Clock::now();
    note_(absl::StrCat("connection lost (", loss.ok() ? "the stream ended" : CodeName(loss.error_code()),
                       loss.error_message().empty() ? "" : ": ", loss.error_message(), "); reconnecting for up to ",
                       HumanDuration(for_s_)));
  }
  const double left_s = for_s_ - std::chrono::duration<double>(Clock::now() - lost_at_).count();
  if (left_s <= 0) return false;
  const double backoff_s = std::min(kLastBackoff_s, kFirstBackoff_s * (1 << std::min(attempts_, 8)));
  ++attempts_;
  return !interrupt_.WaitFor(std::min(backoff_s, left_s));
}

}  // namespace orbitune::cli
