// Cylinders and planes by CGAL's Efficient RANSAC (Schnabel et al. 2007).
//
// Arguments: largest distance, normals' neighbors, largest angle of normals in degrees,
// gap of connected points, fewest points of a shape, least and largest radius,
// probability to miss the best shape.

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Shape_detection/Efficient_RANSAC.h>
#include <CGAL/pca_estimate_normals.h>
#include <CGAL/property_map.h>

#include <cmath>
#include <memory>

#include "cloud.h"

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Oriented = std::pair<Kernel::Point_3, Kernel::Vector_3>;
using Range = std::vector<Oriented>;
using PointMap = CGAL::First_of_pair_property_map<Oriented>;
using NormalMap = CGAL::Second_of_pair_property_map<Oriented>;
using Traits =
    CGAL::Shape_detection::Efficient_RANSAC_traits<Kernel, Range, PointMap, NormalMap>;
using Search = CGAL::Shape_detection::Efficient_RANSAC<Traits>;
using Cylinder = CGAL::Shape_detection::Cylinder<Traits>;
using Plane = CGAL::Shape_detection::Plane<Traits>;

int main(int, char** given) {
  CGAL::get_default_random() = CGAL::Random(0);
  Range points;
  for (const auto& p : read_points())
    points.emplace_back(Kernel::Point_3(p[0], p[1], p[2]), Kernel::Vector_3(0, 0, 0));
  const auto maps = CGAL::parameters::point_map(PointMap()).normal_map(NormalMap());
  CGAL::pca_estimate_normals<CGAL::Sequential_tag>(points, int(setting(given, 2)), maps);

  Search search;
  search.set_input(points);
  search.add_shape_factory<Plane>();
  search.add_shape_factory<Cylinder>();
  Search::Parameters settings;
  settings.epsilon = setting(given, 1);
  settings.normal_threshold = std::cos(setting(given, 3) * CGAL_PI / 180);
  settings.cluster_epsilon = setting(given, 4);
  settings.min_points = size_t(setting(given, 5));
  settings.probability = setting(given, 8);
  search.detect(settings);
  for (const auto& shape : search.shapes()) {
    const auto* cylinder = dynamic_cast<Cylinder*>(shape.get());
    if (cylinder == nullptr) continue;
    const double radius = cylinder->radius();
    if (radius < setting(given, 6) || radius > setting(given, 7)) continue;
    const auto axis = cylinder->axis();
    const auto direction = axis.to_vector() / std::sqrt(axis.to_vector().squared_length());
    const auto point = axis.point(0);
    print_cylinder(std::array<double, 3>{point.x(), point.y(), point.z()},
                   std::array<double, 3>{direction.x(), direction.y(), direction.z()},
                   radius, shape->indices_of_assigned_points().size());
  }
}
