// What every peer reads and prints.
//
// Input: float32 triples x y z in meters on stdin, as many as there are.
// Output: a line for each cylinder: a point of the axis, the axis, the radius and the
// number of inliers.
#pragma once

#include <array>
#include <cstdio>
#include <cstdlib>
#include <vector>

inline std::vector<std::array<float, 3>> read_points() {
  std::vector<std::array<float, 3>> points;
  std::array<float, 3> point;
  while (std::fread(point.data(), sizeof(float), 3, stdin) == 3)
    points.push_back(point);
  return points;
}

// Settings are numbers, given in an order that each peer tells.
inline double setting(char** arguments, int place) {
  return std::atof(arguments[place]);
}

template <typename Vector>
void print_cylinder(const Vector& p, const Vector& a, double radius, size_t inliers) {
  std::printf("%.9g %.9g %.9g %.9g %.9g %.9g %.9g %zu\n", double(p[0]), double(p[1]),
              double(p[2]), double(a[0]), double(a[1]), double(a[2]), radius, inliers);
}
