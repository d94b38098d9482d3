#include "client/cli/errors.h"

#include <gtest/gtest.h>

#include "google/protobuf/struct.pb.h"
#include "google/protobuf/util/json_util.h"
#include "google/rpc/error_details.pb.h"
#include "google/rpc/status.pb.h"

namespace orbitune::cli {
namespace {

grpc::Status DetailedError() {
  google::rpc::BadRequest bad_request;
  auto* violation = bad_request.add_field_violations();
  violation->set_field("job.hyperparameters.step_size");
  violation->set_description("must be > 0; got \"-1\"");
  google::rpc::RetryInfo retry;
  retry.mutable_retry_delay()->set_seconds(2);
  google::rpc::Status status;
  status.add_details()->PackFrom(bad_request);
  status.add_details()->PackFrom(retry);
  return {grpc::StatusCode::INVALID_ARGUMENT, "bad job", status.SerializeAsString()};
}

TEST(Errors, TextTellsEveryField) {
  EXPECT_EQ(RenderError(DetailedError(), false),
            "orbitune: INVALID_ARGUMENT: bad job\n"
            "  job.hyperparameters.step_size: must be > 0; got \"-1\"\n"
            "  try again in 2 s\n");
  EXPECT_EQ(RenderError({grpc::StatusCode::INTERNAL, "x", "not a google.rpc.Status"}, false),
            "orbitune: INTERNAL: x\n");
}

TEST(Errors, JsonIsOneObjectOnOneLine) {
  const std::string text = RenderError(DetailedError(), true);
  EXPECT_EQ(text.find('\n'), text.size() - 1);
  google::protobuf::Struct parsed;
  ASSERT_TRUE(google::protobuf::util::JsonStringToMessage(text, &parsed).ok()) << text;
  const auto& error = parsed.fields().at("error").struct_value().fields();
  EXPECT_EQ(error.at("code").string_value(), "INVALID_ARGUMENT");
  EXPECT_EQ(error.at("message").string_value(), "bad job");
  EXPECT_EQ(error.at("retry_delay_s").number_value(), 2);
  const auto& violation = error.at("field_violations").list_value().values(0).struct_value().fields();
  EXPECT_EQ(violation.at("field").string_value(), "job.hyperparameters.step_size");
  EXPECT_EQ(violation.at("description").string_value(), "must be > 0; got \"-1\"");
}

TEST(Errors, ExitCodes) {
  using grpc::StatusCode;
  for (const auto& [code, exit_code] : std::vector<std::pair<StatusCode, int>>{{StatusCode::OK, 0},
                                                                               {StatusCode::INVALID_ARGUMENT, 2},
                                                                               {StatusCode::NOT_FOUND, 3},
                                                                               {StatusCode::UNAVAILABLE, 4},
                                                                               {StatusCode::DEADLINE_EXCEEDED, 4},
                                                                               {StatusCode::FAILED_PRECONDITION, 5},
                                                                               {StatusCode::ALREADY_EXISTS, 5},
                                                                               {StatusCode::ABORTED, 5},
                                                                               {StatusCode::RESOURCE_EXHAUSTED, 6},
                                                                               {StatusCode::INTERNAL, 6},
                                                                               {StatusCode::UNKNOWN, 6}}) {
    EXPECT_EQ(ExitCodeFor(code), exit_code) << code;
  }
}

}  // namespace
}  // namespace orbitune::cli
