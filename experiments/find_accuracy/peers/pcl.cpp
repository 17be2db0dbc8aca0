// Cylinders by PCL: planes are taken away first, then the largest cylinder by RANSAC
// with normals, again and again until one has too few points.
//
// Arguments: distance threshold, normals' neighbors, weight of normals, least part of a
// plane among all points, fewest points of a cylinder, least and largest radius,
// samples, gap of clusters (0: all objects at once), distance threshold of planes.

#include <pcl/features/normal_3d.h>
#include <pcl/filters/extract_indices.h>
#include <pcl/point_types.h>
#include <pcl/sample_consensus/method_types.h>
#include <pcl/sample_consensus/model_types.h>
#include <pcl/search/kdtree.h>
#include <pcl/segmentation/extract_clusters.h>
#include <pcl/segmentation/sac_segmentation.h>

#include <Eigen/Core>

#include "cloud.h"

using Points = pcl::PointCloud<pcl::PointXYZ>;
using Normals = pcl::PointCloud<pcl::Normal>;

// Points and their normals without some of them.
static void take_away(Points::Ptr& points, Normals::Ptr& normals,
                      const pcl::PointIndices::Ptr& gone) {
  Points::Ptr left(new Points);
  Normals::Ptr left_normals(new Normals);
  pcl::ExtractIndices<pcl::PointXYZ> of_points;
  of_points.setInputCloud(points);
  of_points.setIndices(gone);
  of_points.setNegative(true);
  of_points.filter(*left);
  pcl::ExtractIndices<pcl::Normal> of_normals;
  of_normals.setInputCloud(normals);
  of_normals.setIndices(gone);
  of_normals.setNegative(true);
  of_normals.filter(*left_normals);
  points = left;
  normals = left_normals;
}

int main(int, char** given) {
  const double threshold = setting(given, 1), weight = setting(given, 3);
  const double plane_part = setting(given, 4), fewest = setting(given, 5);
  const double gap = setting(given, 9);
  const int samples = int(setting(given, 8));
  Points::Ptr points(new Points);
  for (const auto& p : read_points()) points->emplace_back(p[0], p[1], p[2]);
  const double all = double(points->size());

  pcl::NormalEstimation<pcl::PointXYZ, pcl::Normal> estimation;
  pcl::search::KdTree<pcl::PointXYZ>::Ptr tree(new pcl::search::KdTree<pcl::PointXYZ>);
  estimation.setSearchMethod(tree);
  estimation.setInputCloud(points);
  estimation.setKSearch(int(setting(given, 2)));
  Normals::Ptr normals(new Normals);
  estimation.compute(*normals);

  pcl::SACSegmentationFromNormals<pcl::PointXYZ, pcl::Normal> search;
  search.setOptimizeCoefficients(true);
  search.setMethodType(pcl::SAC_RANSAC);
  search.setNormalDistanceWeight(weight);
  search.setDistanceThreshold(setting(given, 10));
  search.setMaxIterations(samples);
  search.setRadiusLimits(setting(given, 6), setting(given, 7));
  pcl::PointIndices::Ptr inliers(new pcl::PointIndices);
  pcl::ModelCoefficients found;
  search.setModelType(pcl::SACMODEL_NORMAL_PLANE);
  while (double(points->size()) > plane_part * all) {
    search.setInputCloud(points);
    search.setInputNormals(normals);
    search.segment(*inliers, found);
    if (double(inliers->indices.size()) < plane_part * all) break;
    take_away(points, normals, inliers);
  }

  std::vector<pcl::PointIndices> clusters(1);
  if (gap > 0 && !points->empty()) {
    clusters.clear();
    pcl::EuclideanClusterExtraction<pcl::PointXYZ> extraction;
    extraction.setClusterTolerance(gap);
    extraction.setMinClusterSize(int(fewest));
    extraction.setInputCloud(points);
    extraction.extract(clusters);
  } else {
    for (int k = 0; k < int(points->size()); ++k) clusters[0].indices.push_back(k);
  }
  search.setModelType(pcl::SACMODEL_CYLINDER);
  search.setDistanceThreshold(threshold);
  for (const auto& cluster : clusters) {
    Points::Ptr own(new Points(*points, cluster.indices));
    Normals::Ptr own_normals(new Normals(*normals, cluster.indices));
    while (double(own->size()) >= fewest) {
      search.setInputCloud(own);
      search.setInputNormals(own_normals);
      search.segment(*inliers, found);
      if (double(inliers->indices.size()) < fewest || found.values.size() != 7) break;
      const auto& v = found.values;
      print_cylinder(std::array<float, 3>{v[0], v[1], v[2]},
                     std::array<float, 3>{v[3], v[4], v[5]}, v[6],
                     inliers->indices.size());
      take_away(own, own_normals, inliers);
    }
  }
}
