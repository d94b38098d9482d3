#include "server/rest/static_files.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <map>
#include <optional>
#include <utility>

#include "absl/strings/str_cat.h"
#include "server/rest/error.h"
#include "server/rest/text.h"

namespace orbitune::rest {
namespace {

constexpr off_t kLargestFile = 32 << 20;

// Nothing from elsewhere, nothing inline, in nobody's frame.
constexpr char kSecurityPolicy[] =
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; font-src 'self'; "
    "connect-src 'self'; manifest-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

constexpr char kNoDashboard[] = R"(<!DOCTYPE html>
<html lang="en">
<meta charset="utf-8">
<title>Orbitune</title>
<h1>Orbitune</h1>
<p>The server is running. Its dashboard is not built: with Node.js 18 or newer and npm, run
<code>npm ci &amp;&amp; npm run build</code> in <code>client/web</code>, and start the server with
<code>--web-dir client/web/dist</code>.</p>
<p>What is there without it: <a href="/v1/jobs">/v1/jobs</a>, <a href="/v1/scenarios">/v1/scenarios</a>,
<a href="/openapi.json">/openapi.json</a>, and the command line <code>orbitune</code>.</p>
</html>
)";

std::string_view MimeType(std::string_view path) {
  static const std::map<std::string_view, std::string_view> types = {
      {".html", "text/html; charset=utf-8"},
      {".js", "text/javascript; charset=utf-8"},
      {".mjs", "text/javascript; charset=utf-8"},
      {".css", "text/css; charset=utf-8"},
      {".json", "application/json"},
      {".map", "application/json"},
      {".webmanifest", "application/manifest+json"},
      {".svg", "image/svg+xml"},
      {".png", "image/png"},
      {".ico", "image/x-icon"},
      {".woff2", "font/woff2"},
      {".txt", "text/plain; charset=utf-8"},
  };
  const std::size_t dot = path.rfind('.');
  const auto found = dot == path.npos ? types.end() : types.find(path.substr(dot));
  return found == types.end() ? "application/octet-stream" : found->second;
}

// An open file; nothing where there is no regular file of that name.
class File {
 public:
  static std::optional<File> Open(const std::string& path) {
    File file(open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
    const bool usable = file.descriptor_ >= 0 && fstat(file.descriptor_, &file.stat_) == 0 &&
                        S_ISREG(file.stat_.st_mode) && file.stat_.st_size <= kLargestFile;
    return usable ? std::make_optional(std::move(file)) : std::nullopt;
  }
  File(File&& other) noexcept : descriptor_(std::exchange(other.descriptor_, -1)), stat_(other.stat_) {}
  File& operator=(File&&) = delete;
  ~File() {
    if (descriptor_ >= 0) close(descriptor_);
  }

  // Changes whenever the file is written.
  std::string Tag() const {
    return absl::StrCat(absl::Hex(stat_.st_mtim.tv_sec), "-", absl::Hex(stat_.st_mtim.tv_nsec), "-",
                        absl::Hex(stat_.st_size));
  }

  std::optional<std::string> Read() const {
    std::string contents(static_cast<std::size_t>(stat_.st_size), '\0');
    std::size_t done = 0;
    while (done < contents.size()) {
      const ssize_t count = read(descriptor_, contents.data() + done, contents.size() - done);
      if (count <= 0) return std::nullopt;
      done += static_cast<std::size_t>(count);
    }
    return contents;
  }

 private:
  explicit File(int descriptor) : descriptor_(descriptor) {}
  int descriptor_;
  struct stat stat_ = {};
};

struct Variant {
  std::string_view coding;
  std::string_view suffix;
};
constexpr std::array<Variant, 3> kVariants = {{{"br", ".br"}, {"gzip", ".gz"}, {"", ""}}};

// A path below the directory; nothing for one that would leave it, or names a hidden file.
std::optional<std::string> SafePath(const std::string& path) {
  const auto decoded = PercentDecode(path, false);
  if (!decoded.ok() || decoded->find('\\') != decoded->npos) return std::nullopt;
  for (const std::string_view segment : Split(std::string_view(*decoded).substr(1), '/')) {
    if (segment.empty() || segment.front() == '.') return std::nullopt;
  }
  return *decoded;
}

HttpReply Page(std::string body) {
  HttpReply reply{.code = 200, .headers = {}, .body = std::move(body)};
  reply.headers = {{"Content-Type", "text/html; charset=utf-8"},
                   {"Cache-Control", "no-cache"},
                   {"Content-Security-Policy", kSecurityPolicy},
                   {"Referrer-Policy", "no-referrer"}};
  return reply;
}

bool MatchesTag(std::string_view if_none_match, const std::string& etag) {
  for (std::string_view tag : Split(if_none_match, ',')) {
    tag = Trim(tag);
    if (tag.starts_with("W/")) tag.remove_prefix(2);
    if (tag == "*" || tag == etag) return true;
  }
  return false;
}

// nullopt where there is no such file.
std::optional<HttpReply> Serve(const HttpRequest& request, const std::string& path) {
  for (const Variant& variant : kVariants) {
    if (!variant.coding.empty() && !Accepts(request.header("Accept-Encoding"), variant.coding)) continue;
    const auto file = File::Open(absl::StrCat(path, std::string(variant.suffix)));
    if (!file) continue;
    HttpReply reply = Page("");
    reply.headers[0].second = MimeType(path);
    const std::string etag = absl::StrCat("\"", file->Tag(), std::string(variant.suffix), "\"");
    reply.headers.emplace_back("ETag", etag);
    reply.headers.emplace_back("Vary", "Accept-Encoding");
    if (!variant.coding.empty()) reply.headers.emplace_back("Content-Encoding", variant.coding);
    if (MatchesTag(request.header("If-None-Match"), etag)) {
      reply.code = 304;
      return reply;
    }
    auto contents = file->Read();
    if (!contents) return std::nullopt;
    reply.body = *std::move(contents);
    return reply;
  }
  return std::nullopt;
}

}  // namespace

HttpReply StaticFiles::Get(const HttpRequest& request, const std::string& path) const {
  const std::string index = directory_ + "/index.html";
  if (path == "/") return Serve(request, index).value_or(Page(kNoDashboard));
  if (const auto safe = SafePath(path)) {
    if (auto reply = Serve(request, directory_ + *safe)) return *std::move(reply);
    const bool is_page = safe->find('.') == safe->npos && Accepts(request.header("Accept"), "text/html");
    if (auto reply = is_page ? Serve(request, index) : std::nullopt) return *std::move(reply);
  }
  return ErrorReply(absl::NotFoundError("there is nothing at this path; /openapi.json lists what there is"));
}

}  // namespace orbitune::rest
