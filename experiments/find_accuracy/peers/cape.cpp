// Cylinders by CAPE (Proenca and Gao 2018), whose own files are compiled with this.
//
// Input: points of a whole image, row by row, 0 where there is no reading.
// Arguments: rows, columns, width of a cell in pixels, largest angle of merged cells in
// degrees, largest distance of merged cells in millimeters, distance in meters of a
// point of its segments of cylinders that counts as an inlier: CAPE does not tell which
// segment is whose.

#include <climits>
#include <cmath>
#include <cstring>

#include "CAPE.h"
#include "cloud.h"

// Labels up to here are of planes.
constexpr int FIRST_PLANES = 50;

int main(int, char** given) {
  const int rows = int(setting(given, 1)), columns = int(setting(given, 2));
  const int cell = int(setting(given, 3)), across = columns / cell;
  const double reach = 1e3 * setting(given, 6);
  const auto points = read_points();
  Eigen::MatrixXf cells = Eigen::MatrixXf::Zero(rows * columns, 3);
  // CAPE wants the points of a cell one after the other, in millimeters.
  std::vector<int> pixel_of(size_t(rows) * columns);
  for (int row = 0; row < rows; ++row)
    for (int column = 0; column < columns; ++column) {
      const int own = (row / cell * across + column / cell) * cell * cell;
      const int place = own + row % cell * cell + column % cell;
      pixel_of[place] = row * columns + column;
      for (int k = 0; k < 3; ++k) cells(place, k) = 1e3f * points[pixel_of[place]][k];
    }
  CAPE search(rows, columns, cell, cell, true,
              float(std::cos(setting(given, 4) * M_PI / 180)), float(setting(given, 5)));
  int num_planes = 0, num_cylinders = 0;
  cv::Mat labels = cv::Mat_<uchar>(rows, columns, uchar(0));
  std::vector<PlaneSeg> planes;
  std::vector<CylinderSeg> cylinders;
  // It prints.
  std::cout.setstate(std::ios::failbit);
  search.process(cells, num_planes, num_cylinders, labels, planes, cylinders);
  for (const auto& found : cylinders) {
    const Eigen::Vector3d axis(found.axis[0], found.axis[1], found.axis[2]);
    const Eigen::Vector3d center = found.centers[0];
    const double radius = found.radii[0];
    size_t inliers = 0;
    for (int k = 0; k < cells.rows(); ++k) {
      const Eigen::Vector3d point = cells.row(k).transpose().cast<double>();
      if (point[2] <= 0 || labels.data[pixel_of[k]] <= FIRST_PLANES) continue;
      const double wall = (point - center).cross(axis).norm() - radius;
      inliers += std::abs(wall) < reach;
    }
    const Eigen::Vector3d meters = 1e-3 * center;
    print_cylinder(meters, axis, 1e-3 * radius, inliers);
  }
}
