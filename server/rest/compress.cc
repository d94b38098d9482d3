#include "server/rest/compress.h"

#include <zlib.h>

#include "core/base/check.h"

namespace orbitune::rest {
namespace {

constexpr std::size_t kWorthIt = 1024;  // bytes
constexpr int kLevel = 4;               // half the time of the default for a tenth more bytes
constexpr int kGzip = MAX_WBITS + 16;   // of deflateInit2's window bits: a gzip header and trailer
constexpr int kMemory = 8;              // zlib's default

}  // namespace

void Compress(HttpReply& reply) {
  if (reply.body.size() < kWorthIt) return;
  z_stream stream = {};
  if (deflateInit2(&stream, kLevel, Z_DEFLATED, kGzip, kMemory, Z_DEFAULT_STRATEGY) != Z_OK) return;  // out of memory
  std::string packed(deflateBound(&stream, reply.body.size()), '\0');
  stream.next_in = reinterpret_cast<Bytef*>(reply.body.data());
  stream.avail_in = static_cast<uInt>(reply.body.size());
  stream.next_out = reinterpret_cast<Bytef*>(packed.data());
  stream.avail_out = static_cast<uInt>(packed.size());
  const int result = deflate(&stream, Z_FINISH);
  packed.resize(stream.total_out);
  deflateEnd(&stream);
  ORBITUNE_CHECK(result == Z_STREAM_END);  // what deflateBound promises
  reply.body = std::move(packed);
  reply.headers.emplace_back("Content-Encoding", "gzip");
  reply.headers.emplace_back("Vary", "Accept-Encoding");
}

}  // namespace orbitune::rest
