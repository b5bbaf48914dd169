// Stands in until the formats are there.
#include "slicecorr/error.hpp"
#include "stack/archive_format.hpp"
#include "stack/folder_container.hpp"
#include "stack/known_foreign.hpp"
#include "stack/tar_container.hpp"

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
const ArchiveFormat& vdt_format() {
  static const Pending f("vdt");
  return f;
}
const ArchiveFormat& vda_format() {
  static const Pending f("vda");
  return f;
}
const ArchiveFormat& ember_zip_format() {
  static const Pending f("ember_zip");
  return f;
}
const ArchiveFormat& ember_tar_format() {
  static const Pending f("ember_tar");
  return f;
}
const ArchiveFormat& folder_format() {
  static const Pending f("folder");
  return f;
}

std::unique_ptr<Container> open_tar_gz(const std::string& p, const std::string&) {
  throw InputError(p, "", "pending");
}
std::unique_ptr<ContainerOutput> make_tar_gz_output(const std::string& p, const std::string&) {
  throw InputError(p, "", "pending");
}
std::unique_ptr<Container> open_folder(const std::string& p) { throw InputError(p, "", "pending"); }
std::unique_ptr<ContainerOutput> make_folder_output(const std::string& p, const std::string&) {
  throw InputError(p, "", "pending");
}
void refuse_known_foreign(const Container&) {}
void refuse_known_file(const std::string&) {}
}  // namespace slicecorr::detail
