// Stands in until the formats are there.
#include "stack/archive_format.hpp"

namespace slicecorr::detail {
namespace {
class Pending final : public ArchiveFormat {
 public:
  explicit Pending(const char* n) : name_(n) {}
  std::string_view name() const override { return name_; }
  std::string_view what() const override { return ""; }
  std::vector<std::string_view> endings() const override { return {}; }
  bool recognises(const Container&) const override { return false; }
  ArchiveContents read(const Container&) const override { return {}; }
  std::vector<std::string> write(const ArchiveRequest&, ContainerOutput&) const override {
    return {};
  }

 private:
  const char* name_;
};
}  // namespace
const ArchiveFormat& chitubox_zip_format() {
  static const Pending f("chitubox_zip");
  return f;
}
const ArchiveFormat& generic_zip_format() {
  static const Pending f("generic_zip");
  return f;
}
const ArchiveFormat& cws_format() {
  static const Pending f("cws");
  return f;
}
const ArchiveFormat& rgb_cws_format() {
  static const Pending f("rgb_cws");
  return f;
}
const ArchiveFormat& nanodlp_format() {
  static const Pending f("nanodlp");
  return f;
}
const ArchiveFormat& rgb_nanodlp_format() {
  static const Pending f("rgb_nanodlp");
  return f;
}
}  // namespace slicecorr::detail
