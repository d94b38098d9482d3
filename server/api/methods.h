// The RPCs as transports find them: by full name, each with its messages, the threads it runs on, and what answers it.
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <string_view>

#include "absl/status/status.h"
#include "google/protobuf/descriptor.h"
#include "google/protobuf/message.h"
#include "server/api/caller.h"
#include "server/api/executor.h"
#include "server/api/feed.h"

namespace orbitune {

// The method's option orbitune.v1.access.
struct AccessRule {
  Role role = Role::kNone;                                   // the least that may call
  bool changes = false;                                      // something: for the audit log
  const google::protobuf::FieldDescriptor* owned = nullptr;  // of the request: names what must be the caller's
  std::string collection;                                    // that it names one of: "jobs"
};

struct Method {
  const google::protobuf::MethodDescriptor* descriptor = nullptr;
  const google::protobuf::Message* request = nullptr;  // prototypes
  const google::protobuf::Message* response = nullptr;
  AccessRule access;
  Work work = Work::kRead;
  std::function<Work(const google::protobuf::Message& request)> work_of;  // where it depends on the request; else none
  // Exactly one of the two. The messages are of the prototypes' types; `answer` may block, `open` does not.
  std::function<absl::Status(const google::protobuf::Message& request, google::protobuf::Message* response,
                             const CallContext& context)>
      answer;
  std::function<std::shared_ptr<Feed>(const google::protobuf::Message& request, const CallContext& context)> open;
};

// Filled once, then constant: thread-safe from then on.
class MethodTable {
 public:
  // `api` outlives the table. name: the method's full one, "orbitune.v1.TuningService.GetJob".
  template <typename Api, typename Request, typename Response>
  void Add(std::string_view name, Work work, Api* api, absl::Status (Api::*method)(const Request&, Response*)) {
    AddUnary<Request, Response>(name, work,
                                [api, method](const Request& request, Response* response, const CallContext&) {
                                  return (api->*method)(request, response);
                                });
  }

  template <typename Api, typename Request, typename Response>
  void Add(std::string_view name, Work work, Api* api,
           absl::Status (Api::*method)(const Request&, Response*, const Cancelled&)) {
    AddUnary<Request, Response>(name, work,
                                [api, method](const Request& request, Response* response, const CallContext& context) {
                                  return (api->*method)(request, response, context.cancelled);
                                });
  }

  template <typename Api, typename Request, typename Response>
  void Add(std::string_view name, Work work, Api* api,
           absl::Status (Api::*method)(const Request&, Response*, const CallContext&)) {
    AddUnary<Request, Response>(name, work,
                                [api, method](const Request& request, Response* response, const CallContext& context) {
                                  return (api->*method)(request, response, context);
                                });
  }

  // The threads depend on the request.
  template <typename Api, typename Request, typename Response>
  void Add(std::string_view name, Api* api, absl::Status (Api::*method)(const Request&, Response*, const Cancelled&),
           Work (*work_of)(const Request&)) {
    Add(name, Work::kRead, api, method);
    methods_.find(name)->second.work_of = [work_of](const google::protobuf::Message& request) {
      return work_of(static_cast<const Request&>(request));
    };
  }

  template <typename Response, typename Api, typename Request>
  void AddStream(std::string_view name, Api* api, std::shared_ptr<Feed> (Api::*method)(const Request&)) {
    Method entry = {.request = &Request::default_instance(), .response = &Response::default_instance()};
    entry.open = [api, method](const google::protobuf::Message& request, const CallContext&) {
      return (api->*method)(static_cast<const Request&>(request));
    };
    Insert(name, std::move(entry));
  }

  template <typename Response, typename Api, typename Request>
  void AddStream(std::string_view name, Api* api,
                 std::shared_ptr<Feed> (Api::*method)(const Request&, const CallContext&)) {
    Method entry = {.request = &Request::default_instance(), .response = &Response::default_instance()};
    entry.open = [api, method](const google::protobuf::Message& request, const CallContext& context) {
      return (api->*method)(static_cast<const Request&>(request), context);
    };
    Insert(name, std::move(entry));
  }

  // nullptr for an unknown one.
  const Method* Find(std::string_view name) const;

  // By full name.
  const std::map<std::string, Method, std::less<>>& all() const { return methods_; }

 private:
  template <typename Request, typename Response, typename Answer>
  void AddUnary(std::string_view name, Work work, Answer answer) {
    Method entry = {.request = &Request::default_instance(), .response = &Response::default_instance(), .work = work};
    entry.answer = [answer](const google::protobuf::Message& request, google::protobuf::Message* response,
                            const CallContext& context) {
      return answer(static_cast<const Request&>(request), static_cast<Response*>(response), context);
    };
    Insert(name, std::move(entry));
  }
  void Insert(std::string_view name, Method entry);

  std::map<std::string, Method, std::less<>> methods_;
};

}  // namespace orbitune
