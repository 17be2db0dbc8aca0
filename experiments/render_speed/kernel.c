// A capped cylinder seen by a pinhole camera: depth, normal and mask of every pixel.
//
// What the renderer's work costs without JAX, in single precision: rows are shared
// among threads, neighboring columns fill a vector register. On the ray t d, with
// d = (x, y, 1), center c, axis a, m = d x a and w = c x a, the stretch inside the
// round wall is centered on t = m.w / m.m, and the ray passes the axis at a distance
// of |d.w| / |m|. All these are linear in x before the products, so that a row computes
// its share once.
//
// The renderer's guards are missing: a ray exactly along the axis or along a cap may
// be drawn wrong.

#include <math.h>
#include <stddef.h>
#include <stdint.h>

enum { BLOCK = 128 };  // columns whose normals wait in the first-level cache

void render(const float *cylinder,  // center, axis (unit), radius, height
            const float *camera,    // fx, fy, cx, cy
            int width, int height, int threads,
            float nothing,  // depth where nothing is hit; -ffast-math has no infinity
            float *depth, float *normal, uint8_t *mask) {
  const float cx = cylinder[0], cy = cylinder[1], cz = cylinder[2];
  const float ax = cylinder[3], ay = cylinder[4], az = cylinder[5];
  const float radius = cylinder[6], half_height = cylinder[7] / 2;
  const float per_radius = 1 / radius, per_fx = 1 / camera[0], u0 = camera[2];
  const float wx = cy * az - cz * ay, wy = cz * ax - cx * az, wz = cx * ay - cy * ax;
  const float c_a = cx * ax + cy * ay + cz * az;

#pragma omp parallel for schedule(static) num_threads(threads)
  for (int row = 0; row < height; row++) {
    const float y = (row - camera[3]) / camera[1];
    const float mx = y * az - ay, row_d_a = y * ay + az, row_d_w = y * wy + wz;
    for (int first = 0; first < width; first += BLOCK) {
      const int size = width - first < BLOCK ? width - first : BLOCK;
      const size_t start = (size_t)row * width + first;
      float *restrict z = depth + start, *restrict n = normal + 3 * start;
      uint8_t *restrict seen = mask + start;
      float nx[BLOCK], ny[BLOCK], nz[BLOCK];
#pragma omp simd
      for (int i = 0; i < size; i++) {
        const float x = (first + i - u0) * per_fx;
        const float my = ax - x * az, mz = x * ay - y * ax;
        const float per_m_m = 1 / (mx * mx + my * my + mz * mz);
        const float d_w = row_d_w + x * wx, d_a = row_d_a + x * ax;
        const float gap = radius * radius - d_w * d_w * per_m_m;
        const float middle = (mx * wx + my * wy + mz * wz) * per_m_m;
        const float half = sqrtf((gap > 0 ? gap : 0) * per_m_m);
        const float per_d_a = 1 / d_a, between = c_a * per_d_a;
        const float slab = half_height * fabsf(per_d_a);

        const float enter = fmaxf(middle - half, between - slab);
        const float leave = fminf(middle + half, between + slab);
        const int outside = enter > 0;
        const int hit = (gap >= 0) & (enter <= leave) & (leave > 0);
        const int cap =
            outside ? between - slab > middle - half : between + slab < middle + half;
        const float t = outside ? enter : leave;

        const float qx = t * x - cx, qy = t * y - cy, qz = t - cz;
        const float along = qx * ax + qy * ay + qz * az;
        const float facing = outside ? per_radius : -per_radius;
        float of_q = cap ? 0 : facing;
        float of_a = cap ? (d_a > 0 ? -1.f : 1.f) : -along * facing;
        of_q = hit ? of_q : 0;
        of_a = hit ? of_a : 0;
        nx[i] = of_q * qx + of_a * ax;
        ny[i] = of_q * qy + of_a * ay;
        nz[i] = of_q * qz + of_a * az;
        z[i] = hit ? t : nothing;
        seen[i] = hit;
      }
#pragma omp simd
      for (int i = 0; i < size; i++) {
        n[3 * i] = nx[i];
        n[3 * i + 1] = ny[i];
        n[3 * i + 2] = nz[i];
      }
    }
  }
}
