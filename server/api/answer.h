// What every method of the API does with the answer of a use case.
#pragma once

#include "absl/status/statusor.h"

namespace orbitune {

// Writes the value to `out`, or hands back the error.
template <typename T, typename Proto>
absl::Status Answer(const absl::StatusOr<T>& value, Proto* out) {
  if (value.ok()) ToProto(*value, out);
  return value.status();
}

// Likewise for a page, whose items go where `add` points: AnswerPage(page, out, [&] { return out->add_jobs(); }).
template <typename Page, typename Response, typename Add>
absl::Status AnswerPage(const absl::StatusOr<Page>& page, Response* out, Add add) {
  if (!page.ok()) return page.status();
  for (const auto& item : page->items) ToProto(item, add());
  out->set_next_page_token(page->next_page_token);
  return absl::OkStatus();
}

}  // namespace orbitune
