// Capped cylinders seen by a pinhole camera: what the renderer's work costs without JAX.
//
// In single precision; rows are shared among threads, neighboring columns fill a vector
// register. On the ray t d with d = (x, y, 1), center c and unit axis a, the part of d
// across the axis has the squared length A = d.d - (d.a)^2. The stretch inside the round
// wall is centered on t = (d.c - (d.a)(a.c)) / A, and half of it is the root of
// r^2 A - (d.(a x c))^2, over A. Every dot of d is linear in x (d.d: quadratic), so that
// a row computes its share once.
//
// The renderer's guards are missing: a ray exactly along the axis or along a cap may be
// drawn wrong, and a camera inside a solid sees nothing of it. Depth is z; the center of
// the pixel in column u and row v is (u, v).

#include <math.h>
#include <stddef.h>
#include <stdint.h>

#define INLINE static inline __attribute__((always_inline))

enum { BLOCK = 128 };          // columns whose normals wait in the first-level cache
enum { BANDS_PER_THREAD = 8 };  // of rows of a scene, dealt out one by one

typedef struct {
  float cx, cy, cz, ax, ay, az, radius, height;
} Cylinder;

typedef struct {
  float fx, fy, cx, cy;
} Camera;

typedef struct {  // a cylinder, and what a row of pixels computes once for it
  float cx, cy, cz, ax, ay, az, radius, half, per_radius, c_a, wx;
  float y, d_a, d_c, d_w, d_d;  // the dots at x = 0
  float per_fx, u0;
} Row;

typedef struct {
  float x, d_a, t;
  int hit, cap;
} Hit;

INLINE Row row_of(Cylinder k, Camera camera, int v) {
  const float y = (v - camera.cy) / camera.fy;
  const float wx = k.ay * k.cz - k.az * k.cy, wy = k.az * k.cx - k.ax * k.cz;
  const float wz = k.ax * k.cy - k.ay * k.cx;
  return (Row){
      .cx = k.cx, .cy = k.cy, .cz = k.cz, .ax = k.ax, .ay = k.ay, .az = k.az,
      .radius = k.radius, .half = k.height / 2, .per_radius = 1 / k.radius,
      .c_a = k.cx * k.ax + k.cy * k.ay + k.cz * k.az, .wx = wx, .y = y,
      .d_a = y * k.ay + k.az, .d_c = y * k.cy + k.cz, .d_w = y * wy + wz,
      .d_d = y * y + 1, .per_fx = 1 / camera.fx, .u0 = camera.cx,
  };
}

INLINE Hit cast(Row k, int u) {
  const float x = (u - k.u0) * k.per_fx;
  const float d_a = k.d_a + x * k.ax, d_c = k.d_c + x * k.cx, d_w = k.d_w + x * k.wx;
  const float across = k.d_d + x * x - d_a * d_a, per_across = 1 / across;
  const float gap = k.radius * k.radius * across - d_w * d_w;
  const float middle = (d_c - k.c_a * d_a) * per_across;
  const float reach = sqrtf(gap > 0 ? gap : 0) * per_across;
  const float per_d_a = 1 / d_a, between = k.c_a * per_d_a;
  const float slab = fabsf(k.half * per_d_a);
  const float wall_in = middle - reach, cap_in = between - slab;
  const float wall_out = middle + reach, cap_out = between + slab;
  const int cap = cap_in > wall_in;
  const float enter = cap ? cap_in : wall_in;
  const float leave = wall_out < cap_out ? wall_out : cap_out;
  const int hit = (gap > 0) & (enter <= leave) & (enter > 0);
  return (Hit){.x = x, .d_a = d_a, .t = enter, .hit = hit, .cap = cap};
}

// From the center to the point that is hit, and its part along the axis.
#define OFFSET(k, hit)                                                             \
  const float px = (hit).t * (hit).x - (k).cx, py = (hit).t * (k).y - (k).cy;      \
  const float pz = (hit).t - (k).cz;                                               \
  const float along = px * (k).ax + py * (k).ay + pz * (k).az;

// The normal is of_p p + of_a a.
#define NORMAL(k, hit)                                                             \
  OFFSET(k, hit)                                                                   \
  const float of_p = (hit).cap ? 0 : (k).per_radius;                               \
  const float of_a =                                                               \
      (hit).cap ? ((hit).d_a > 0 ? -1.f : 1.f) : -along * (k).per_radius;

static void planes_of_row(Row k, int width, float nothing, float *restrict depth,
                          float *restrict nx, float *restrict ny, float *restrict nz,
                          uint8_t *restrict mask) {
#pragma omp simd
  for (int u = 0; u < width; u++) {
    const Hit at = cast(k, u);
    NORMAL(k, at)
    depth[u] = at.hit ? at.t : nothing;
    nx[u] = at.hit ? of_p * px + of_a * k.ax : 0;
    ny[u] = at.hit ? of_p * py + of_a * k.ay : 0;
    nz[u] = at.hit ? of_p * pz + of_a * k.az : 0;
    mask[u] = at.hit;
  }
}

static void vectors_of_row(Row k, int width, float nothing, float *restrict depth,
                           float *restrict normal, uint8_t *restrict mask) {
  float n[3][BLOCK];
  for (int first = 0; first < width; first += BLOCK) {
    const int size = width - first < BLOCK ? width - first : BLOCK;
    Row moved = k;
    moved.u0 -= first;
    planes_of_row(moved, size, nothing, depth + first, n[0], n[1], n[2], mask + first);
    float *restrict to = normal + 3 * (size_t)first;
#pragma omp simd
    for (int i = 0; i < size; i++) {
      to[3 * i] = n[0][i];
      to[3 * i + 1] = n[1][i];
      to[3 * i + 2] = n[2][i];
    }
  }
}

// Depth (`nothing` on a miss: -ffast-math has no infinity), normal and mask of one
// cylinder; normals as vectors (height, width, 3), or as planes (3, height, width).
void frame(const Cylinder *cylinder, const Camera *camera, int width, int height,
           int threads, float nothing, int planes, float *depth, float *normal,
           uint8_t *mask) {
  const size_t size = (size_t)width * height;
#pragma omp parallel for schedule(static) num_threads(threads)
  for (int v = 0; v < height; v++) {
    const Row k = row_of(*cylinder, *camera, v);
    const size_t at = (size_t)v * width;
    if (planes)
      planes_of_row(k, width, nothing, depth + at, normal + at, normal + size + at,
                    normal + 2 * size + at, mask + at);
    else
      vectors_of_row(k, width, nothing, depth + at, normal + 3 * at, mask + at);
  }
}

// Squared difference to a target (`nothing` where it has no reading) over the pixels
// that both see, and its derivatives in center, axis, radius and height, as out[9].
//
// By the implicit function theorem: on the wall, with q = p - (p.a) a, the depth moves by
// (q.dc + (p.a) q.da + r dr) / q.d; on a cap at the side s of the center, by
// (a.dc - p.da + s dh / 2) / a.d.
void loss(const Cylinder *cylinder, const Camera *camera, int width, int height,
          int threads, float nothing, const float *target, double *out) {
  double total[9] = {0};
#pragma omp parallel for schedule(static) num_threads(threads) reduction(+ : total[:9])
  for (int v = 0; v < height; v++) {
    const Row k = row_of(*cylinder, *camera, v);
    const float *wanted = target + (size_t)v * width;
    float sum = 0, cx = 0, cy = 0, cz = 0, ax = 0, ay = 0, az = 0, r = 0, h = 0;
#pragma omp simd reduction(+ : sum, cx, cy, cz, ax, ay, az, r, h)
    for (int u = 0; u < width; u++) {
      const Hit at = cast(k, u);
      const int both = at.hit & (wanted[u] < nothing);
      const float error = both ? at.t - wanted[u] : 0;
      OFFSET(k, at)
      const float qx = px - along * k.ax, qy = py - along * k.ay;
      const float qz = pz - along * k.az;
      const float slope = at.cap ? at.d_a : qx * at.x + qy * k.y + qz;
      const float weight = both ? 2 * error / slope : 0;
      const float wall = at.cap ? 0 : weight, cap = at.cap ? weight : 0;
      const float turned = wall * along;
      sum += error * error;
      cx += wall * qx + cap * k.ax;
      cy += wall * qy + cap * k.ay;
      cz += wall * qz + cap * k.az;
      ax += turned * qx - cap * px;
      ay += turned * qy - cap * py;
      az += turned * qz - cap * pz;
      r += wall * k.radius;
      h += at.d_a > 0 ? -cap / 2 : cap / 2;
    }
    const float parts[9] = {sum, cx, cy, cz, ax, ay, az, r, h};
    for (int i = 0; i < 9; i++) total[i] += parts[i];
  }
  for (int i = 0; i < 9; i++) out[i] = total[i];
}

// Columns [box[0], box[1]) and rows [box[2], box[3]) outside of which a cylinder is not
// seen: around the corners of the boxes that enclose its two ends.
static void box_of(Cylinder k, Camera camera, int width, int height, int *box) {
  const float a[3] = {k.ax, k.ay, k.az}, c[3] = {k.cx, k.cy, k.cz};
  float least[2] = {1e9f, 1e9f}, most[2] = {-1e9f, -1e9f};
  for (int corner = 0; corner < 16; corner++) {
    float p[3];
    for (int i = 0; i < 3; i++) {
      const float flat = 1 - a[i] * a[i], aside = k.radius * sqrtf(flat > 0 ? flat : 0);
      const float end = corner & 8 ? k.height / 2 : -k.height / 2;
      p[i] = c[i] + end * a[i] + (corner >> i & 1 ? aside : -aside);
    }
    const float per_z = 1 / fmaxf(p[2], 1e-3f);
    const float uv[2] = {camera.fx * p[0] * per_z + camera.cx,
                         camera.fy * p[1] * per_z + camera.cy};
    for (int i = 0; i < 2; i++) {
      least[i] = fminf(least[i], uv[i]);
      most[i] = fmaxf(most[i], uv[i]);
    }
  }
  const int size[2] = {width, height};
  for (int i = 0; i < 2; i++) {
    box[2 * i] = least[i] < 0 ? 0 : (int)fminf(least[i], 1e6f);
    box[2 * i + 1] = most[i] < 0 ? 0 : (int)fminf(most[i] + 2, (float)size[i]);
  }
}

static void nearer_in_row(Row k, int first, int end, int number, float *restrict depth,
                          int *restrict index) {
#pragma omp simd
  for (int u = first; u < end; u++) {
    const Hit at = cast(k, u);
    const int seen = at.hit & (at.t < depth[u]);
    depth[u] = seen ? at.t : depth[u];
    index[u] = seen ? number : index[u];
  }
}

static void normals_of_row(const Cylinder *cylinders, Camera camera, int v, int width,
                           const float *depth, const int *index, float *nx, float *ny,
                           float *nz, uint8_t *mask) {
  const float y = (v - camera.cy) / camera.fy;
  for (int u = 0; u < width; u++) {
    nx[u] = ny[u] = nz[u] = 0;
    mask[u] = index[u] >= 0;
    if (!mask[u]) continue;
    const Cylinder k = cylinders[index[u]];
    const float t = depth[u], x = (u - camera.cx) / camera.fx, per_radius = 1 / k.radius;
    const float px = t * x - k.cx, py = t * y - k.cy, pz = t - k.cz;
    const float along = px * k.ax + py * k.ay + pz * k.az;
    const int cap = fabsf(along) > k.height / 2 * (1 - 1e-4f);
    const float of_p = cap ? 0 : per_radius;
    const float of_a = cap ? (along > 0 ? 1.f : -1.f) : -along * per_radius;
    nx[u] = of_p * px + of_a * k.ax;
    ny[u] = of_p * py + of_a * k.ay;
    nz[u] = of_p * pz + of_a * k.az;
  }
}

// The closest of many cylinders: depth, which one (-1 for none), normals as planes, mask.
// Each is cast in its box alone, and normals are computed of what is seen in the end.
void scene(const Cylinder *cylinders, int count, const Camera *camera, int width,
           int height, int threads, float nothing, int *boxes, float *depth, int *index,
           float *normal, uint8_t *mask) {
  const size_t size = (size_t)width * height;
  const int bands = threads * BANDS_PER_THREAD;
  for (int j = 0; j < count; j++)
    box_of(cylinders[j], *camera, width, height, boxes + 4 * j);
#pragma omp parallel for schedule(dynamic, 1) num_threads(threads)
  for (int band = 0; band < bands; band++) {
    const int top = height * band / bands, end = height * (band + 1) / bands;
    for (size_t i = (size_t)top * width; i < (size_t)end * width; i++) {
      depth[i] = nothing;
      index[i] = -1;
    }
    for (int j = 0; j < count; j++) {
      const int *box = boxes + 4 * j;
      const int first = box[2] > top ? box[2] : top, last = box[3] < end ? box[3] : end;
      for (int v = first; v < last; v++) {
        const size_t at = (size_t)v * width;
        const Row k = row_of(cylinders[j], *camera, v);
        nearer_in_row(k, box[0], box[1], j, depth + at, index + at);
      }
    }
    for (int v = top; v < end; v++) {
      const size_t at = (size_t)v * width;
      normals_of_row(cylinders, *camera, v, width, depth + at, index + at, normal + at,
                     normal + size + at, normal + 2 * size + at, mask + at);
    }
  }
}
