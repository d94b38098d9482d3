// Paths of the dashboard's files: nothing but what lies in its directory, and is not hidden, is ever sent.
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "server/rest/static_files.h"
#include "tests/fuzz/fuzz.h"

namespace orbitune::fuzz {
namespace {

constexpr char kSecret[] = "not to be sent";

// A directory with a file to serve, one that is hidden, and one beside it. Removed at the end.
class Site {
 public:
  Site() : directory_("/dev/shm/orbitune-fuzz-site-" + std::to_string(getpid())) {
    std::filesystem::create_directories(directory_ / "web/assets");
    Write("web/index.html", "page");
    Write("web/assets/app.js", "script");
    Write("web/assets/app.js.gz", "packed");
    Write("web/.hidden", kSecret);
    Write("web/assets/.hidden", kSecret);
    Write("outside", kSecret);
    Write("web.txt", kSecret);
  }
  ~Site() {
    std::error_code error;
    std::filesystem::remove_all(directory_, error);
  }

  std::string web() const { return (directory_ / "web").string(); }

 private:
  void Write(const char* name, const char* text) const { std::ofstream(directory_ / name) << text; }
  const std::filesystem::path directory_;
};

// The first line is the path, the second Accept-Encoding, the third If-None-Match.
void StaticFile(std::string_view input) {
  static const Site site;
  static const rest::StaticFiles files(site.web());
  const auto target = rest::ParseTarget(TakeLine(input));
  if (!target.ok()) return;
  rest::HttpRequest request{.method = "GET", .target = "", .headers = {{"Accept", "text/html"}}, .body = ""};
  request.headers["Accept-Encoding"] = TakeLine(input);
  request.headers["If-None-Match"] = TakeLine(input);
  const rest::HttpReply reply = files.Get(request, target->path);
  Expect(reply.code == 200 || reply.code == 304 || reply.code == 404, "a file, or none");
  Expect(reply.body.find(kSecret) == reply.body.npos, "nothing hidden, nothing from elsewhere");
  for (const auto& [name, value] : reply.headers) {
    Expect(value.find_first_of("\r\n") == value.npos, "a header is one line");
  }
}

const Registration kStaticFile("static_file", StaticFile);

}  // namespace
}  // namespace orbitune::fuzz
