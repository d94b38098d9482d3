// Errors that a user, a disk or a network can cause: absl::Status whose InvalidArgument names the field, the allowed
// range and the value received. What only a bug can cause is ORBITUNE_CHECK's (check.h).
#pragma once

#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

namespace orbitune {

// Debian's absl has a string_view of its own; this is the one bridge.
inline absl::string_view ToAbsl(std::string_view s) { return {s.data(), s.size()}; }

struct FieldViolation {
  std::string field;        // path in the caller's terms, e.g. "hyperparameters.step_size"
  std::string description;  // "must be > 0, got -1"
};

// The shortest decimal that reads back as the same double.
std::string FormatNumber(double value);

// A user's text, quoted and shortened, fit to stand in an error.
std::string FormatReceived(std::string_view text);

// Collects every fault of an input, so that a user sees them all at once. Not thread-safe.
class FieldErrors {
 public:
  // allowed: "in [0, 1)", "> 0", ...; received: the value as text.
  void Add(std::string_view field, std::string_view allowed, std::string_view received);
  void AddNumber(std::string_view field, std::string_view allowed, double received);
  // Takes over another check's violations, each under `prefix` + "."; other errors become one violation of `prefix`.
  void Merge(std::string_view prefix, const absl::Status& status);

  void AddViolation(FieldViolation violation) { violations_.push_back(std::move(violation)); }

  bool empty() const { return violations_.empty(); }
  // OK if nothing was added, else INVALID_ARGUMENT.
  absl::Status ToStatus() const;

 private:
  std::vector<FieldViolation> violations_;
};

absl::Status InvalidField(std::string_view field, std::string_view allowed, double received);

// The violations a status carries; none for another kind of status.
std::vector<FieldViolation> FieldViolationsOf(const absl::Status& status);

// A machine-readable reason (google.rpc.ErrorInfo's), e.g. "REQUEST_ID_REUSED".
absl::Status WithReason(absl::Status status, std::string_view reason);
std::string ReasonOf(const absl::Status& status);

}  // namespace orbitune
