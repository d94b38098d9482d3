// Which folder may include which: the order of ARCHITECTURE.md, read from the sources.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <string>
#include <string_view>
#include <vector>

namespace orbitune {
namespace {

namespace fs = std::filesystem;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

struct Folder {
  std::string_view path;
  std::vector<std::string_view> may_include;  // ours; its own headers always
};

// What is generated from proto/ counts as a folder of ours.
constexpr std::string_view kProto = "orbitune/v1";

// Each folder that holds code, in order.
const std::vector<Folder>& Folders() {
  static const auto* const folders = new std::vector<Folder>{
      {"core/base", {}},
      {"core/orbit", {"core/base"}},
      {"core/control", {"core/base", "core/orbit"}},
      {"core/sim", {"core/base", "core/orbit", "core/control"}},
      {"core/simd", {"core/base", "core/orbit", "core/control", "core/sim"}},
      {"core/search", {"core/base", "core/orbit", "core/control", "core/sim"}},
      {"core/scenario", {"core/base", "core/orbit", "core/control", "core/sim", "core/search"}},
      {"core/library",
       {"core/base", "core/orbit", "core/control", "core/sim", "core/simd", "core/search", "core/scenario"}},
      {"storage", {"core"}},
      {"server/log", {}},
      {"server/jobs", {"core", "storage", "server/log"}},
      {"server/service", {"core", "storage", "server/log", "server/jobs"}},
      {"server/convert", {"core", "storage", "server/log", "server/jobs", "server/service", kProto}},
      {"server/access", {"core", "storage", "server/log"}},
      {"server/api",
       {"core", "storage", "server/log", "server/jobs", "server/service", "server/convert", "server/access", kProto}},
      {"server/rpc",
       {"core", "storage", "server/log", "server/jobs", "server/service", "server/convert", "server/access",
        "server/api", kProto}},
      {"server/rest",
       {"core", "storage", "server/log", "server/jobs", "server/service", "server/convert", "server/access",
        "server/api", kProto}},
      {"server/metrics",
       {"core", "storage", "server/log", "server/jobs", "server/service", "server/convert", "server/access",
        "server/api", kProto}},
      {"server/config", {"core", "storage", "server/log", "server/jobs", "server/service"}},
      {"server/commands", {"core", "storage", "server/log", "server/access", "server/config"}},
      {"server", {"core", "storage", "server", kProto}},  // main.cc alone: wiring
      {"client/cli", {kProto}},
  };
  return *folders;
}

// Headers beginning so, and the only folders that may include them.
struct Library {
  std::vector<std::string_view> prefixes;
  std::vector<std::string_view> users;
};

const std::vector<Library>& Libraries() {
  static const auto* const libraries = new std::vector<Library>{
      {{"grpc/", "grpcpp/"}, {"server/rpc", "server", "client/cli"}},
      {{"google/"}, {"server/convert", "server/api", "server/rpc", "server/rest", "server", "client/cli"}},
      {{"sqlite3"}, {"storage"}},
      {{"Random123/"}, {"core/base"}},
      {{"hwy/"}, {"core/simd"}},
      {{"nanoflann"}, {"core/library"}},
      {{"prometheus/"}, {"server/metrics"}},
      {{"openssl/"}, {"core/library", "server/access"}},
      {{"boost/", "nlohmann/", "CLI/"}, {"storage", "server/rest", "server/config", "server/commands", "client/cli"}},
  };
  return *libraries;
}

bool IsIn(std::string_view path, std::string_view folder) {
  return path.starts_with(folder) && (path.size() == folder.size() || path[folder.size()] == '/');
}

// The longest of ours that holds a path; nullptr for none.
const Folder* FolderOf(std::string_view path) {
  const Folder* best = nullptr;
  for (const Folder& folder : Folders()) {
    if (IsIn(path, folder.path) && (best == nullptr || folder.path.size() > best->path.size())) best = &folder;
  }
  return best;
}

bool IsOurs(std::string_view include) {
  return std::ranges::any_of(std::vector<std::string_view>{"core", "storage", "server", "client", "tests", kProto},
                             [&](std::string_view top) { return IsIn(include, top); });
}

// Empty if a file of `folder` may include `include`, else why not.
std::string Fault(const Folder& folder, std::string_view include) {
  for (const Library& library : Libraries()) {
    const auto begins = [&](std::string_view prefix) { return include.starts_with(prefix); };
    if (std::ranges::any_of(library.prefixes, begins) &&
        std::ranges::find(library.users, folder.path) == library.users.end()) {
      return "a library that this folder may not know";
    }
  }
  if (!IsOurs(include)) return "";
  const Folder* included = FolderOf(include);
  if (included == &folder) return "";
  const bool allowed = std::ranges::any_of(folder.may_include, [&](std::string_view f) { return IsIn(include, f); });
  return allowed ? "" : "it points the wrong way";
}

// The header that a line includes; empty if it is no such line.
std::string IncludedBy(std::string_view line) {
  for (const std::string_view word : {"#", "include"}) {
    line.remove_prefix(std::min(line.find_first_not_of(" \t"), line.size()));
    if (!line.starts_with(word)) return "";
    line.remove_prefix(word.size());
  }
  const std::size_t begin = line.find_first_of("\"<");
  const std::size_t end = line.find_first_of("\">", begin + 1);
  return begin == line.npos || end == line.npos ? "" : std::string(line.substr(begin + 1, end - begin - 1));
}

// One line for each include under `root` that points the wrong way, and each source file outside of the folders known.
std::vector<std::string> CheckIncludes(const fs::path& root) {
  std::vector<std::string> faults;
  for (const char* top : {"core", "storage", "server", "client"}) {
    if (!fs::exists(root / top)) continue;
    for (const auto& entry : fs::recursive_directory_iterator(root / top)) {
      const std::string extension = entry.path().extension().string();
      if (!entry.is_regular_file() || (extension != ".h" && extension != ".cc")) continue;
      const std::string path = fs::relative(entry.path(), root).generic_string();
      const Folder* folder = FolderOf(path);
      if (folder == nullptr || fs::path(path).parent_path() != fs::path(folder->path)) {
        faults.push_back(path + ": a folder that has no place in the order");
        continue;
      }
      std::ifstream file(entry.path());
      for (std::string line; std::getline(file, line);) {
        const std::string include = IncludedBy(line);
        const std::string fault = Fault(*folder, include);
        if (!fault.empty()) faults.push_back(path + " includes " + include + ": " + fault);
      }
    }
  }
  std::ranges::sort(faults);
  return faults;
}

TEST(IncludesTest, NoIncludePointsTheWrongWay) {
  ASSERT_TRUE(fs::exists(fs::path(ORBITUNE_SOURCE_DIR) / "core/base/status.h")) << "nothing was checked";
  EXPECT_THAT(CheckIncludes(ORBITUNE_SOURCE_DIR), IsEmpty());
}

// A made-up tree, to see that the check can fail.
class MadeUpTreeTest : public ::testing::Test {
 protected:
  ~MadeUpTreeTest() override { fs::remove_all(root_); }

  void Write(const std::string& path, const std::string& text) {
    fs::create_directories((root_ / path).parent_path());
    std::ofstream(root_ / path) << text;
  }

  const fs::path root_ =
      fs::path(::testing::TempDir()) /
      (std::string("includes_test_") + ::testing::UnitTest::GetInstance()->current_test_info()->name());
};

TEST_F(MadeUpTreeTest, AcceptsTheOrder) {
  Write("core/orbit/a.cc", "#include <cmath>\n#include \"core/base/status.h\"\n#include \"core/orbit/a.h\"\n");
  Write("core/simd/b.cc", "#include \"core/sim/episode.h\"\n#include <hwy/highway.h>\n");
  Write("storage/c.cc", "#include <sqlite3.h>\n\n#include \"core/scenario/scenario.h\"\n");
  Write("server/rpc/d.cc", "#include <grpcpp/grpcpp.h>\n#include \"orbitune/v1/service.pb.h\"\n");
  Write("server/main.cc", "#include \"server/rpc/server.h\"\n");
  Write("client/cli/e.cc", "#include \"client/cli/e.h\"\n#include \"orbitune/v1/service.pb.h\"\n");
  Write("core/README.md", "#include \"server/main.h\"\n");
  EXPECT_THAT(CheckIncludes(root_), IsEmpty());
}

TEST_F(MadeUpTreeTest, FindsWhatPointsTheWrongWay) {
  Write("core/base/a.h", "  #  include \"core/sim/episode.h\"\n");
  Write("core/control/b.cc", "#include \"core/simd/kernel.h\"\n");
  Write("core/sim/c.cc", "#include \"core/search/ars.h\"\n#include \"server/jobs/scheduler.h\"\n");
  Write("core/search/d.cc", "#include \"core/scenario/presets.h\"\n");
  Write("storage/e.cc", "#include \"server/jobs/scheduler.h\"\n");
  Write("server/jobs/f.cc", "#include \"server/service/service.h\"\n#include \"orbitune/v1/job.pb.h\"\n");
  Write("server/rest/g.cc", "#include \"server/rpc/server.h\"\n");
  Write("client/cli/h.cc", "#include \"core/base/status.h\"\n");
  Write("core/orbit/i.cc", "#include \"tests/core/testing.h\"\n");
  EXPECT_THAT(CheckIncludes(root_), ElementsAre(HasSubstr("client/cli/h.cc includes core/base/status.h"),
                                                HasSubstr("core/base/a.h includes core/sim/episode.h"),
                                                HasSubstr("core/control/b.cc includes core/simd/kernel.h"),
                                                HasSubstr("core/orbit/i.cc includes tests/core/testing.h"),
                                                HasSubstr("core/search/d.cc includes core/scenario/presets.h"),
                                                HasSubstr("core/sim/c.cc includes core/search/ars.h"),
                                                HasSubstr("core/sim/c.cc includes server/jobs/scheduler.h"),
                                                HasSubstr("server/jobs/f.cc includes orbitune/v1/job.pb.h"),
                                                HasSubstr("server/jobs/f.cc includes server/service/service.h"),
                                                HasSubstr("server/rest/g.cc includes server/rpc/server.h"),
                                                HasSubstr("storage/e.cc includes server/jobs/scheduler.h")));
}

TEST_F(MadeUpTreeTest, FindsLibrariesWhereTheyDoNotBelong) {
  Write("core/base/a.cc", "#include <google/protobuf/message.h>\n#include <grpcpp/grpcpp.h>\n#include <sqlite3.h>\n");
  Write("server/service/b.cc", "#include <grpcpp/grpcpp.h>\n");
  Write("server/api/d.cc", "#include <google/protobuf/message.h>\n#include <grpcpp/grpcpp.h>\n");
  Write("core/orbit/c.cc", "#include <Random123/philox.h>\n");
  EXPECT_EQ(CheckIncludes(root_).size(), 6u);
}

TEST_F(MadeUpTreeTest, FindsAFolderThatHasNoPlace) {
  Write("core/plugins/a.cc", "");
  Write("server/rpc/inner/b.cc", "");
  EXPECT_THAT(CheckIncludes(root_), ElementsAre(HasSubstr("core/plugins/a.cc"), HasSubstr("server/rpc/inner/b.cc")));
}

}  // namespace
}  // namespace orbitune
