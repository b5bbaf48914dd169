// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// From the models of a 3MF to the mesh that is printed: items, components, and what of them is a part.
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <set>
#include <stdexcept>
#include <utility>

#include "mesh/mesh_parts.hpp"
#include "mesh/model_3mf.hpp"
#include "mesh/package_3mf.hpp"
#include "mesh/project_3mf.hpp"
#include "mesh/shapes_3mf.hpp"
#include "slicecorr/error.hpp"
#include "support/text/ascii.hpp"

namespace slicecorr::detail {
namespace {

constexpr std::uint64_t kMostObjects = 1'000'000;  // objects of the build, repeated ones counted
constexpr int kMostLevels = 64;

/// Triangles of one solid that do the same to it.
class Share3mf {
 public:
  void add(const Object3mf& object, std::size_t first, std::size_t past,
           const Transform3mf& transform, const std::string& path) {
    constexpr std::uint32_t unused = std::numeric_limits<std::uint32_t>::max();
    std::vector<std::uint32_t> merged(object.vertices.size(), unused);
    const bool mirrored = transform.determinant() < 0;  // turns the inside out
    for (std::size_t t = first; t < past; ++t) {
      std::array<std::uint32_t, 3> triangle{};
      for (std::size_t k = 0; k < 3; ++k) {
        const std::uint32_t index = object.triangles[t][k];
        if (merged[index] == unused) {
          const Point3 point = transform.apply(object.vertices[index]);
          require_finite(point, path, "vertex " + std::to_string(index + 1));
          merged[index] = pool_.index(point);
        }
        triangle[k] = merged[index];
      }
      if (mirrored) std::swap(triangle[1], triangle[2]);
      triangles_.push_back(triangle);
    }
  }
  /// Bodies are not merged with others where they touch.
  void add(const Bodies3mf& bodies, const Transform3mf& transform, const std::string& path) {
    const auto offset = static_cast<std::uint32_t>(bodies_.vertices.size());
    if (bodies_.vertices.size() + bodies.vertices.size() > 0x7fffffff) {
      throw InputError(path, "", "has more corners than fit");
    }
    for (const Point3& p : bodies.vertices) {
      bodies_.vertices.push_back(transform.apply(p));
      require_finite(bodies_.vertices.back(), path, "a corner of a beam or slice");
    }
    const bool mirrored = transform.determinant() < 0;
    for (auto [a, b, c] : bodies.triangles) {
      if (mirrored) std::swap(b, c);
      bodies_.triangles.push_back({a + offset, b + offset, c + offset});
    }
  }
  std::size_t size() const { return triangles_.size() + bodies_.triangles.size(); }
  TriangleMesh take() {
    TriangleMesh mesh{pool_.take(), std::move(triangles_), {}};
    if (bodies_.triangles.empty()) return mesh;
    append(mesh, {std::move(bodies_.vertices), std::move(bodies_.triangles), {}});
    return mesh;
  }

 private:
  VertexPool pool_{1024};
  std::vector<std::array<std::uint32_t, 3>> triangles_;
  Bodies3mf bodies_;
};

/// Counts of one kind, with its name: "1 modifier", "2 modifiers".
struct LeftOut {
  std::size_t count = 0;
  const char *one, *many;
  const char* why;
};

class Reader3mf {
 public:
  Reader3mf(std::string_view bytes, const std::string& path, const Placement& placement)
      : path_(path), placement_(placement), package_(bytes, path) {}

  TriangleMesh read(double& unit_mm, std::vector<std::string>& notes) {
    const std::string root = package_.model_part();
    root_ = root;
    // What the model points to must be there, though only models are read.
    package_.relations(root);
    project_ = read_project_3mf(package_, path_);
    Model3mf& model = load(root);
    unit_mm = model.unit_mm;
    for (const Item3mf& item : model.items) add_item(item);
    tell(notes);
    TriangleMesh mesh = take();
    const bool adds = mesh.shares.empty() ||
                      std::any_of(mesh.shares.begin(), mesh.shares.end(),
                                  [](const auto& share) { return share.role == SolidRole::added; });
    if (adds && !mesh.triangles.empty()) return mesh;
    std::string why;
    for (const std::string& note : notes) why += (why.empty() ? ": " : "; ") + note;
    throw InputError(path_, "",
                     "holds no triangles" + std::string(why.empty() ? "" : " that print") + why);
  }

 private:
  /// An object's place in the expansion of an item.
  struct Placed {
    Transform3mf transform;
    std::uint32_t solid = 0;
    SolidRole role = SolidRole::added;
    const Project3mf::Parts* parts = nullptr;  ///< of the components of this object
  };
  struct Weight {
    std::uint64_t objects = 1;
    int levels = 0;
  };

  [[noreturn]] void fail(const std::string& part, std::size_t line, const std::string& what) const {
    throw InputError(path_, part + (line ? ", line " + std::to_string(line) : ""), what);
  }

  Model3mf& load(const std::string& part) {
    const auto found = models_.find(lower_case(part));
    if (found != models_.end()) return found->second;
    Model3mf model = read_model_3mf(package_, part, path_);
    if (!models_.empty() && model.unit_mm != models_.at(lower_case(root_)).unit_mm) {
      throw InputError(path_, part, "has another unit than " + root_);
    }
    notes_.insert(model.notes.begin(), model.notes.end());
    return models_.emplace(lower_case(part), std::move(model)).first->second;
  }

  /// The part that a path names, or the one that it stands in.
  std::string part_of(const std::string& path, const std::string& part) const {
    return path.empty() ? part : package_.resolve(path, part);
  }

  const Object3mf& object_of(const Component3mf& component, const std::string& from,
                             std::string& part) {
    part = part_of(component.path, from);
    const Model3mf& model = load(part);
    const auto found = model.objects.find(component.object);
    if (found != model.objects.end()) return found->second;
    fail(from, component.line,
         "there is no object " + std::to_string(component.object) + " in " + part);
  }

  /// How often an object multiplies what it is made of, and how deep; each object is looked at once.
  const Weight& weigh(const Component3mf& component, const std::string& from, int depth) {
    std::string part;
    const Object3mf& object = object_of(component, from, part);
    const std::string key = lower_case(part) + '#' + std::to_string(object.id);
    const auto found = weights_.find(key);
    if (found != weights_.end()) {
      if (found->second.objects == 0) {
        fail(from, component.line,
             "components contain themselves: they repeat each other without a sensible end");
      }
      return found->second;
    }
    if (depth > kMostLevels) refuse_repeats(from, component.line);
    weights_[key].objects = 0;  // until it is known
    Weight weight;
    for (const Component3mf& own : object.components) {
      const Weight& its = weigh(own, part, depth + 1);
      weight.objects += its.objects;
      weight.levels = std::max(weight.levels, its.levels + 1);
      if (weight.objects > kMostObjects || weight.levels > kMostLevels) {
        refuse_repeats(part, own.line);
      }
    }
    return weights_[key] = weight;
  }
  [[noreturn]] void refuse_repeats(const std::string& part, std::size_t line) const {
    fail(part, line, "components repeat each other without a sensible end");
  }

  void add_item(const Item3mf& item) {
    objects_ += weigh(item.object, root_, 0).objects;
    if (objects_ > kMostObjects) refuse_repeats(root_, item.object.line);
    std::string part;
    const Object3mf& object = object_of(item.object, root_, part);
    if (object.type == Type3mf::other) {
      fail(root_, item.object.line,
           "the build has object " + std::to_string(object.id) +
               " of the type 'other', which 3MF does not allow: expected a model or a support");
    }
    if (!item.printable) {
      ++unprintable_.count;
      return;
    }
    Placed placed;
    placed.transform = item.object.transform;
    // Projects name objects of the model that they lie beside.
    bool cut = false;
    if (part == root_) {
      const auto parts = project_.parts.find(object.id);
      if (parts != project_.parts.end()) {
        placed.parts = &parts->second;
        for (const auto& [id, volume] : parts->second) {
          cut |= volume == Volume3mf::negative;
          check_part(object, id, volume);
        }
      }
    }
    if (cut) placed.solid = ++solids_;
    add_object(object, part, placed);
  }

  void check_part(const Object3mf& object, std::uint32_t id, Volume3mf volume) const {
    if (volume == Volume3mf::part || (object.components.empty() && id == object.id)) return;
    for (const Component3mf& component : object.components) {
      if (component.object == id) return;
    }
    fail(project_.name, 0,
         "says that part " + std::to_string(id) + " of object " + std::to_string(object.id) +
             " is no ordinary one; the object has no such component");
  }

  /// Whether a volume of this kind goes on to the mesh; else it is noted.
  bool takes_part(Volume3mf volume, Placed& placed) {
    switch (volume) {
      case Volume3mf::part:
        return true;
      case Volume3mf::negative:
        ++negative_.count;
        placed.role = SolidRole::taken_away;
        return true;
      case Volume3mf::modifier:
        ++modifiers_.count;
        return false;
      case Volume3mf::blocker:
        ++blockers_.count;
        return false;
      case Volume3mf::enforcer:
        ++enforcers_.count;
        return false;
    }
    return true;
  }

  void add_object(const Object3mf& object, const std::string& part, Placed placed) {
    if (object.type == Type3mf::support) return void(++supports_.count);
    if (object.type == Type3mf::surface) return void(++surfaces_.count);
    if (object.type == Type3mf::other) return void(++others_.count);
    if (placed.parts && object.components.empty()) {
      const auto own = placed.parts->find(object.id);
      if (own != placed.parts->end() && !takes_part(own->second, placed)) return;
    }
    for (const Component3mf& component : object.components) {
      std::string its_part;
      const Object3mf& its = object_of(component, part, its_part);
      Placed inner = placed;
      inner.parts = nullptr;
      inner.transform = combine(component.transform, placed.transform);
      if (placed.parts) {
        const auto found = placed.parts->find(component.object);
        if (found != placed.parts->end() && !takes_part(found->second, inner)) continue;
      }
      add_object(its, its_part, inner);
    }
    if (!object.components.empty()) return;
    // Slices are what somebody made to be printed. A mesh beside them may be a box that stands in
    // for them, also where it does not say so.
    if (object.slices > 0) {
      if (placed.transform.planar()) return add_slices_of(object, part, placed);
      if (object.coarse_mesh) {
        fail(part, object.line,
             "slices of object " + std::to_string(object.id) +
                 " are turned out of their plane or stretched across it, which 3MF does not allow");
      }
      ++sliced_.count;
    }
    const auto ranges = project_.ranges.find(object.id);
    if (part == root_ && ranges != project_.ranges.end()) {
      for (const Project3mf::Range& range : ranges->second) {
        if (range.volume == Volume3mf::negative && placed.solid == 0) placed.solid = ++solids_;
      }
      add_ranges(object, ranges->second, placed);
    } else {
      add_triangles(object, 0, object.triangles.size(), placed);
    }
    if (object.lattice) add_lattice(object, part, placed);
  }

  static std::array<Point3, 2> box_of(const Object3mf& object) {
    constexpr double infinity = std::numeric_limits<double>::infinity();
    std::array<Point3, 2> box{{{infinity, infinity, infinity}, {-infinity, -infinity, -infinity}}};
    for (const auto& t : object.triangles) {
      for (const std::uint32_t v : t) {
        for (std::size_t k = 0; k < 3; ++k) {
          box[0][k] = std::min(box[0][k], object.vertices[v][k]);
          box[1][k] = std::max(box[1][k], object.vertices[v][k]);
        }
      }
    }
    return box;
  }

  Share3mf& share(std::uint32_t solid, SolidRole role) { return shares_[{solid, role}]; }

  void count(std::size_t more) {
    triangles_ += more;
    if (triangles_ > kMost3mfTriangles) {
      throw InputError(path_, "", "more than " + std::to_string(kMost3mfTriangles) + " triangles");
    }
  }

  void add_triangles(const Object3mf& object, std::size_t first, std::size_t past,
                     const Placed& placed) {
    if (first == past) return;
    count(past - first);
    // Of a few triangles that name a few of many corners, a million times over.
    corners_ += object.vertices.size();
    if (corners_ > 4 * kMost3mfTriangles) refuse_repeats(root_, 0);
    share(placed.solid, placed.role).add(object, first, past, placed.transform, path_);
  }

  void add_ranges(const Object3mf& object, const std::vector<Project3mf::Range>& ranges,
                  const Placed& placed) {
    std::vector<Project3mf::Range> sorted = ranges;
    std::sort(sorted.begin(), sorted.end(),
              [](const auto& a, const auto& b) { return a.first < b.first; });
    std::size_t done = 0;
    for (const Project3mf::Range& range : sorted) {
      if (range.last >= object.triangles.size() || range.first < done) {
        fail(project_.name, range.line,
             "a volume of the triangles " + std::to_string(range.first) + " to " +
                 std::to_string(range.last) + " of object " + std::to_string(object.id) +
                 ", which has " + std::to_string(object.triangles.size()) +
                 "; expected volumes that do not overlap");
      }
      add_triangles(object, done, range.first, placed);
      done = std::size_t{range.last} + 1;
      Placed own = placed;
      if (takes_part(range.volume, own)) add_triangles(object, range.first, done, own);
    }
    add_triangles(object, done, object.triangles.size(), placed);
  }

  void add_lattice(const Object3mf& object, const std::string& part, const Placed& placed) {
    const Lattice3mf& lattice = *object.lattice;
    double stretch = 0;
    for (std::size_t r = 0; r < 3; ++r) {
      const Point3& row = placed.transform.rows[r];
      stretch = std::max(stretch, std::hypot(row[0], row[1], row[2]));
    }
    const double unit_mm = load(part).unit_mm;
    const double tolerance = kBeamToleranceMm / (stretch * scale_to_mm(placement_, unit_mm));
    const Object3mf* clip_mesh = nullptr;
    std::optional<std::array<Point3, 2>> box;
    if (lattice.clipping != Lattice3mf::Clipping::none) {
      clip_mesh = &load(part).objects.at(lattice.clipping_mesh);
      if (placed.solid != 0) {
        fail(
            part, object.line,
            "beams that are clipped, in an object from which volumes are taken away, are not read");
      }
      // What is clipped for certain gives the part no size.
      if (lattice.clipping == Lattice3mf::Clipping::inside) box = box_of(*clip_mesh);
    }
    Bodies3mf bodies;
    try {
      short_.count += add_beams(object, tolerance, kMost3mfTriangles - triangles_, box, bodies);
    } catch (const std::length_error&) {
      fail(part, object.line,
           "the beams of object " + std::to_string(object.id) + " take more than " +
               std::to_string(kMost3mfTriangles) + " triangles to be round");
    }
    count(bodies.triangles.size());
    Placed own = placed;
    if (clip_mesh) {
      own.solid = ++solids_;
      Placed clip = own;
      clip.role = lattice.clipping == Lattice3mf::Clipping::inside ? SolidRole::kept_within
                                                                   : SolidRole::taken_away;
      add_triangles(*clip_mesh, 0, clip_mesh->triangles.size(), clip);
    }
    if (!bodies.triangles.empty()) {
      share(own.solid, own.role).add(bodies, placed.transform, path_);
    }
    beams_.count += lattice.beams.size();
  }

  void add_slices_of(const Object3mf& object, const std::string& from, const Placed& placed) {
    if (object.lattice) {
      fail(from, object.line,
           "object " + std::to_string(object.id) + " has both slices and beams, expected one kind");
    }
    const std::string part = part_of(object.slices_path, from);
    const Slices3mf& stack = stack_of(object.slices, part, from, object.line);
    Bodies3mf bodies;
    double bottom = stack.bottom;
    const auto add = [&](const Slices3mf& slices, const std::string& in, double from_z) {
      for (const Slices3mf::Slice& slice : slices.slices) {
        if (slice.open) fail(in, slice.line, "a contour of the slice is not closed");
        if (doubled_area(slice) < 0) {
          fail(in, slice.line,
               "contours of the slice run clockwise, expected area around which they "
               "run counter-clockwise");
        }
      }
      if (!slices.slices.empty() && !(slices.slices.front().top > from_z)) {
        fail(in, slices.slices.front().line,
             "a slice whose top (ztop) is not above what lies below it");
      }
      add_slices(slices.slices, from_z, bodies);
      if (bodies.triangles.size() > kMost3mfTriangles) count(bodies.triangles.size());
    };
    std::size_t slices = stack.slices.size();
    add(stack, part, bottom);
    bool first = true;
    for (const Slices3mf::Reference& reference : stack.references) {
      const std::string other = package_.resolve(reference.path, part);
      if (lower_case(other) == lower_case(part)) {
        fail(part, reference.line, "slices that refer to slices of the same part");
      }
      const Slices3mf& its = stack_of(reference.id, other, part, reference.line);
      if (!its.references.empty()) {
        fail(part, reference.line, "slices that refer to slices which refer to others");
      }
      if (first) bottom = its.bottom;
      first = false;
      add(its, other, bottom);
      if (!its.slices.empty()) bottom = its.slices.back().top;
      slices += its.slices.size();
    }
    if (slices == 0) fail(part, stack.line, "slices that are none");
    count(bodies.triangles.size());
    share(placed.solid, placed.role).add(bodies, placed.transform, path_);
    ++stacks_.count;
  }

  const Slices3mf& stack_of(std::uint32_t id, const std::string& part, const std::string& from,
                            std::size_t line) {
    const Model3mf& model = load(part);
    const auto found = model.slices.find(id);
    if (found != model.slices.end()) return found->second;
    fail(from, line, "there is no slicestack " + std::to_string(id) + " in " + part);
  }

  void tell(std::vector<std::string>& notes) const {
    notes.insert(notes.end(), notes_.begin(), notes_.end());
    for (const LeftOut* kind :
         {&negative_, &modifiers_, &blockers_, &enforcers_, &unprintable_, &supports_, &surfaces_,
          &others_, &stacks_, &sliced_, &beams_, &short_}) {
      if (kind->count == 0) continue;
      notes.push_back(std::to_string(kind->count) + " " +
                      (kind->count == 1 ? kind->one : kind->many) + " " + kind->why);
    }
  }

  TriangleMesh take() {
    // Solids from which nothing is taken are one with all others.
    TriangleMesh mesh;
    bool shares = false;
    for (auto& [key, own] : shares_) {
      if (own.size() == 0) continue;
      const auto& [solid, role] = key;
      const auto first = static_cast<std::uint32_t>(mesh.triangles.size());
      TriangleMesh part = own.take();
      shares |= solid != 0 || role != SolidRole::added;
      if (mesh.triangles.empty()) {
        mesh = std::move(part);
      } else {
        append(mesh, part);
      }
      shares_of_mesh_.push_back({first, solid, role});
    }
    if (shares) mesh.shares = std::move(shares_of_mesh_);
    return mesh;
  }

  const std::string& path_;
  const Placement& placement_;
  Package3mf package_;
  std::string root_;
  Project3mf project_;
  std::map<std::string, Model3mf> models_;
  std::map<std::string, Weight> weights_;  ///< by part and object
  std::uint64_t objects_ = 0;
  std::size_t triangles_ = 0, corners_ = 0;
  std::uint32_t solids_ = 0;
  std::map<std::pair<std::uint32_t, SolidRole>, Share3mf> shares_;
  std::vector<TriangleMesh::Share> shares_of_mesh_;
  std::set<std::string> notes_;
  LeftOut negative_{0, "negative volume", "negative volumes", "taken away from the part"};
  LeftOut modifiers_{0, "modifier", "modifiers", "left out: no part"};
  LeftOut blockers_{0, "support blocker", "support blockers", "left out: no part"};
  LeftOut enforcers_{0, "support enforcer", "support enforcers", "left out: no part"};
  LeftOut unprintable_{0, "item", "items", "left out: switched off (not printable)"};
  LeftOut supports_{0, "object", "objects", "of the type 'support' left out: no solid"};
  LeftOut surfaces_{0, "object", "objects", "of the type 'surface' left out: no solid"};
  LeftOut others_{0, "object", "objects", "of the type 'other' left out: no part"};
  LeftOut stacks_{0, "object", "objects",
                  "made of the slices in the file, not of the mesh beside them"};
  LeftOut sliced_{0, "object has", "objects have",
                  "slices, left out: turned out of their plane; the mesh counts"};
  LeftOut beams_{0, "beam", "beams", "with round faces, 0.004 mm from round at the most"};
  LeftOut short_{0, "beam", "beams", "left out: shorter than the file's least length"};
};

}  // namespace

TriangleMesh read_3mf(std::string_view bytes, const std::string& path, const Placement& placement,
                      double& unit_mm, std::vector<std::string>& notes) {
  return Reader3mf(bytes, path, placement).read(unit_mm, notes);
}

}  // namespace slicecorr::detail
