// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "mesh/project_3mf.hpp"

#include <string_view>

#include "support/text/ascii.hpp"

namespace slicecorr::detail {
namespace {

class ProjectReader3mf final : public Xml3mf {
 public:
  using Xml3mf::Xml3mf;
  Project3mf project;

 private:
  void element_begins(const XmlElement& element, std::size_t depth) override {
    const std::string_view name = element.name;
    if (depth == 1) object_ = 0;
    if (depth == 2) range_ = nullptr;
    if (depth == 1 && name == "object") {
      object_ = whole(element, "id", 0);
    } else if (depth == 2 && object_ > 0 && name == "volume") {
      range_ = &project.ranges[object_].emplace_back();
      range_->first = whole(element, "firstid", 0);
      range_->last = whole(element, "lastid", 0);
      range_->line = line();
      if (range_->last < range_->first) fail("a volume whose lastid is below its firstid");
    } else if (depth == 2 && object_ > 0 && name == "part") {
      std::string_view kind;
      if (!has(element, {}, "subtype", kind)) kind = "normal_part";
      project.parts[object_][whole(element, "id", 0)] = volume_named(kind);
    } else if (depth == 3 && range_ && name == "metadata") {
      std::string_view key, value;
      has(element, {}, "key", key);
      has(element, {}, "value", value);
      if (key == "volume_type") range_->volume = volume_named(value);
      // What versions before there were other kinds wrote.
      if (key == "modifier" && value == "1" && range_->volume == Volume3mf::part) {
        range_->volume = Volume3mf::modifier;
      }
    }
  }

  Volume3mf volume_named(std::string_view name) const {
    struct Kind {
      std::string_view prusa, bambu;
      Volume3mf volume;
    };
    constexpr Kind kinds[] = {{"ModelPart", "normal_part", Volume3mf::part},
                              {"NegativeVolume", "negative_part", Volume3mf::negative},
                              {"ParameterModifier", "modifier_part", Volume3mf::modifier},
                              {"SupportBlocker", "support_blocker", Volume3mf::blocker},
                              {"SupportEnforcer", "support_enforcer", Volume3mf::enforcer}};
    for (const Kind& kind : kinds) {
      if (name == kind.prusa || name == kind.bambu) return kind.volume;
    }
    fail("a volume of the unknown kind '" + std::string(name.substr(0, 40)) +
         "', expected ModelPart, NegativeVolume, ParameterModifier, SupportBlocker or "
         "SupportEnforcer (normal_part, negative_part, modifier_part, support_blocker or "
         "support_enforcer)");
  }

  std::uint32_t object_ = 0;
  Project3mf::Range* range_ = nullptr;
};

}  // namespace

Project3mf read_project_3mf(const Package3mf& package, const std::string& path) {
  std::string part;
  for (const std::string& found : package.parts("Metadata/", "_model.config")) {
    // One of several that say the same: that of PrusaSlicer.
    if (part.empty() || lower_case(found) == "metadata/slic3r_pe_model.config") part = found;
  }
  if (part.empty() && package.has("Metadata/model_settings.config")) {
    part = "Metadata/model_settings.config";
  }
  if (part.empty()) return {};
  ProjectReader3mf reader(path, part);
  package.read_xml(part, reader);
  reader.project.name = part;
  return std::move(reader.project);
}

}  // namespace slicecorr::detail
