#include "server/rest/chunk.h"

#include "absl/strings/str_cat.h"
#include "core/base/status.h"
#include "server/rest/error.h"

namespace orbitune::rest {
namespace {

constexpr std::string_view kChunkEnd = "\r\n";

net::const_buffer Keep(std::string text, Chunk& chunk) {
  chunk.own.push_back(std::make_shared<const std::string>(std::move(text)));
  return net::buffer(*chunk.own.back());
}

}  // namespace

void Frame(Chunk& chunk) {
  if (chunk.text.empty()) return;
  chunk.text.insert(chunk.text.begin(), Keep(absl::StrCat(absl::Hex(net::buffer_size(chunk.text)), "\r\n"), chunk));
  chunk.text.push_back(net::buffer(kChunkEnd));
}

Chunk ToChunk(Feed::Batch batch, bool sse) {
  Chunk chunk;
  chunk.parts = std::move(batch.parts);
  chunk.end = batch.end;
  chunk.nothing_more = !chunk.parts.empty() && chunk.parts.front().front()->about.last;
  std::size_t events = 0;
  std::string lines;
  for (const StreamPart& part : chunk.parts) {
    for (std::size_t i = part.begin; i < part.end; ++i) events += part.run->items()[i]->about.events;
    if (sse) {
      chunk.text.push_back(net::buffer(part.run->Events(part.begin, part.end)));
    } else {
      for (std::size_t i = part.begin; i < part.end; ++i) absl::StrAppend(&lines, ToAbsl(part.run->Line(i)), "\n");
    }
  }
  chunk.full = events >= kBatch;
  if (!lines.empty()) chunk.text = {Keep(std::move(lines), chunk)};
  if (batch.end && !batch.end->ok()) {
    const std::string error = rest::ErrorJson(*batch.end);
    chunk.text = {Keep(sse ? absl::StrCat("event: error\ndata: ", error, "\n\n") : error + "\n", chunk)};
  }
  return chunk;
}

}  // namespace orbitune::rest
