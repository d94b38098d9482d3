// Structs as JSON and back, by their fields (storage/serialise_fields.h). For storage/serialise.cc alone.
#pragma once

#include <cmath>
#include <concepts>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"
#include "storage/serialise_fields.h"

namespace orbitune::serialise {

using Json = nlohmann::ordered_json;

constexpr std::string_view kInfinity = "Infinity";
constexpr std::string_view kMinusInfinity = "-Infinity";

inline Json Encode(double value) {
  if (std::isnan(value)) return nullptr;
  if (std::isinf(value)) return value > 0 ? kInfinity : kMinusInfinity;
  return value;
}
inline Json Encode(bool value) { return value; }
inline Json Encode(const std::string& value) { return value; }
inline Json Encode(const std::map<std::string, std::string>& value) { return value; }
template <std::integral T>
Json Encode(T value) {
  return value;
}
template <typename E>
requires std::is_enum_v<E> Json Encode(E value) { return kNames<E>[static_cast<std::size_t>(value)]; }
template <typename... F>
Json Encode(const std::variant<F...>& state);
inline Json Encode(const Gains& gains);
template <typename T>
Json Encode(const std::vector<T>& values);
template <typename T>
Json Encode(const std::optional<T>& value);

template <typename T>
requires std::is_class_v<T> Json Encode(const T& value);

struct FieldEncoder {
  template <typename T>
  void operator()(const char* name, const T& field) {
    object[name] = Encode(field);
  }
  template <typename T>
  void Later(const char* name, const T& field) {
    Json value = Encode(field);
    if (value != Encode(T{})) object[name] = std::move(value);
  }
  Json object = Json::object();
};

template <typename T>
requires std::is_class_v<T> Json Encode(const T& value) {
  FieldEncoder encoder;
  VisitFields(value, encoder);
  return std::move(encoder.object);
}

template <typename... F>
Json Encode(const std::variant<F...>& state) {
  Json object;
  VisitForms(&state, [&](const char* name, const auto& form) {
    const auto* held = std::get_if<std::remove_cvref_t<decltype(form)>>(&state);
    if (held != nullptr) object[name] = Encode(*held);
  });
  return object;
}

inline Json Encode(const Gains& gains) {
  Json array = Json::array();
  for (const double gain : gains) array.push_back(Encode(gain));
  return array;
}

template <typename T>
Json Encode(const std::vector<T>& values) {
  Json array = Json::array();
  for (const T& value : values) array.push_back(Encode(value));
  return array;
}

template <typename T>
Json Encode(const std::optional<T>& value) {
  return value ? Encode(*value) : Json();
}

inline std::string Dump(const Json& json) { return json.dump(-1, ' ', false, Json::error_handler_t::replace); }

// Reads into structs and keeps the first fault met; what is read after one is of no use.
class Decoder {
 public:
  const absl::Status& status() const { return status_; }

  void Read(const Json& json, const std::string& path, double& value) {
    if (json.is_null()) {
      value = std::numeric_limits<double>::quiet_NaN();
    } else if (json.is_number()) {
      value = json.get<double>();
    } else if (json == kInfinity || json == kMinusInfinity) {
      value = json == kInfinity ? std::numeric_limits<double>::infinity() : -std::numeric_limits<double>::infinity();
    } else {
      Fault(path, "is not a number");
    }
  }

  void Read(const Json& json, const std::string& path, bool& value) {
    if (Expect(json.is_boolean(), path, "is not a boolean")) value = json.get<bool>();
  }

  void Read(const Json& json, const std::string& path, std::string& value) {
    if (Expect(json.is_string(), path, "is not a text")) value = json.get<std::string>();
  }

  template <std::integral T>
  void Read(const Json& json, const std::string& path, T& value) {
    const bool fits = json.is_number_unsigned()
                          ? std::in_range<T>(json.get<std::uint64_t>())
                          : json.is_number_integer() && std::in_range<T>(json.get<std::int64_t>());
    if (Expect(fits, path, "is not an integer in its range")) value = json.get<T>();
  }

  template <typename E>
  requires std::is_enum_v<E>
  void Read(const Json& json, const std::string& path, E& value) {
    for (std::size_t i = 0; i < kNames<E>.size(); ++i) {
      if (json == kNames<E>[i]) {
        value = static_cast<E>(i);
        return;
      }
    }
    Fault(path, "is not one of the known names");
  }

  void Read(const Json& json, const std::string& path, std::map<std::string, std::string>& value) {
    if (!Expect(json.is_object(), path, "is not an object")) return;
    for (const auto& [key, text] : json.items()) Read(text, absl::StrCat(path, ".", key), value[key]);
  }

  void Read(const Json& json, const std::string& path, Gains& gains) {
    if (!Expect(json.is_array() && json.size() == gains.size(), path, "is not an array of five")) return;
    for (std::size_t i = 0; i < gains.size(); ++i) Read(json[i], absl::StrCat(path, "[", i, "]"), gains[i]);
  }

  template <typename T>
  void Read(const Json& json, const std::string& path, std::vector<T>& values) {
    if (!Expect(json.is_array(), path, "is not an array")) return;
    values.resize(json.size());
    for (std::size_t i = 0; i < json.size(); ++i) Read(json[i], absl::StrCat(path, "[", i, "]"), values[i]);
  }

  template <typename T>
  void Read(const Json& json, const std::string& path, std::optional<T>& value) {
    value.reset();
    if (!json.is_null()) Read(json, path, value.emplace());
  }

  template <typename... F>
  void Read(const Json& json, const std::string& path, std::variant<F...>& state) {
    if constexpr ((std::same_as<F, std::monostate> || ...)) {
      if (json.is_null()) {
        state = std::monostate();
        return;
      }
    }
    if (!Expect(json.is_object() && json.size() == 1, path, "is not one form of what it stands for")) return;
    bool known = false;
    VisitForms(&state, [&](const char* name, auto form) {
      if (!json.contains(name)) return;
      known = true;
      Read(json[name], absl::StrCat(path, ".", name), form);
      state = form;
    });
    Expect(known, path, "is of an unknown form");
  }

  template <typename T>
  requires std::is_class_v<T>
  void Read(const Json& json, const std::string& path, T& value) {
    if (!Expect(json.is_object(), path, "is not an object")) return;
    FieldReader reader{*this, json, path};
    VisitFields(value, reader);
    Expect(json.size() == reader.fields, path, "has a field that is not known");
  }

 private:
  struct FieldReader {
    template <typename T>
    void operator()(const char* name, T& field) {
      decoder.Expect(json.contains(name), absl::StrCat(path, ".", name), "is missing");
      Later(name, field);
    }
    template <typename T>
    void Later(const char* name, T& field) {
      const auto found = json.find(name);
      if (found == json.end()) return;
      ++fields;
      decoder.Read(*found, absl::StrCat(path, ".", name), field);
    }
    Decoder& decoder;
    const Json& json;
    const std::string& path;
    std::size_t fields = 0;
  };

  void Fault(const std::string& path, std::string_view fault) {
    if (status_.ok()) status_ = absl::DataLossError(absl::StrCat("damaged document: ", path, " ", ToAbsl(fault)));
  }

  bool Expect(bool condition, const std::string& path, std::string_view fault) {
    if (!condition) Fault(path, fault);
    return condition;
  }

  absl::Status status_;
};

template <typename T>
absl::StatusOr<T> FromJson(std::string_view text, const std::string& name) {
  const Json json = Json::parse(text, nullptr, /*allow_exceptions=*/false);
  if (json.is_discarded()) return absl::DataLossError(absl::StrCat("damaged document: ", name, " is not JSON"));
  Decoder decoder;
  T value{};
  decoder.Read(json, name, value);
  if (!decoder.status().ok()) return decoder.status();
  return value;
}

}  // namespace orbitune::serialise
