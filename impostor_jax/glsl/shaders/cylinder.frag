// First surface of a capped cylinder on the ray of a pixel.
//
// The wall's interval of the ray meets the slab's; the bound entered last (or, from
// inside, left first) is the surface. Formulas and names are those of
// primitives/cylinder.py and geometry/rays.py.

flat in vec3 center;
flat in vec3 axis;
flat in float radius;
flat in float height;
flat in int index;

layout(location = 0) out vec4 position;  // of the surface, and the instance's index
layout(location = 1) out vec4 normal;    // and whether the surface is a cap

#ifdef AS_PUBLISHED

// Rotation that takes the unit vector a to +y.
mat3 upright(vec3 a) {
    vec3 u = normalize(abs(a.x) < 0.5 ? cross(a, vec3(1.0, 0.0, 0.0))
                                      : cross(a, vec3(0.0, 0.0, 1.0)));
    return transpose(mat3(u, a, cross(u, a)));
}

void main() {
    vec3 o, d;
    ray_of_fragment(gl_FragCoord.xy, o, d);
    float r = radius, h = height / 2.0;
    mat3 rotation = upright(axis);
    vec3 c = rotation * (center - o), e = rotation * d;
    float cap_t = -1.0, side_t = -1.0;
    if (e.y != 0.0) {
        float t0 = (c.y - h) / e.y, t1 = (c.y + h) / e.y;
        // Fault 4: between the planes no cap is seen.
        if (t0 > 0.0 && t1 > 0.0) {
            float t = min(t0, t1);
            vec2 aside = t * e.xz - c.xz;
            if (dot(aside, aside) <= r * r) cap_t = t;
        }
    }
    float A = dot(e.xz, e.xz), B = -2.0 * dot(e.xz, c.xz), C = dot(c.xz, c.xz) - r * r;
    // Fault 5: two large numbers, nearly equal.
    float discriminant = B * B - 4.0 * A * C;
    if (discriminant >= 0.0) {
        // Fault 4: only the smaller root, even behind the camera.
        float t = (-B - sqrt(discriminant)) / (2.0 * A);
        if (abs(t * e.y - c.y) < h) side_t = t;
    }
    bool on_cap = cap_t > 0.0 && (side_t <= 0.0 || cap_t < side_t);
    float t = on_cap ? cap_t : side_t;
    if (!(t > 0.0)) discard;
    vec3 p = o + t * d, q = p - center;
    vec3 n = normalize(q);  // Fault 1: that of a sphere.
    // Fault 2: compared with the unit axis, whatever the cylinder's size.
    if (on_cap) n = length(q + axis) > length(q) ? axis : -axis;
    position = vec4(p, float(index));
    normal = vec4(n, on_cap ? 1.0 : 0.0);
    gl_FragDepth = window_depth(p.z);
}

#else

const float INFINITE = 3e38;

struct Interval {
    float lower;
    float upper;
};

const Interval EMPTY = Interval(INFINITE, -INFINITE);
const Interval WHOLE = Interval(-INFINITE, INFINITE);

Interval wall_interval(vec3 o, vec3 d, vec3 a, float radius) {
    // Made from the part across the axis, m stays across it where it is mere rounding.
    vec3 e = d - a * dot(d, a), p = o - a * dot(o, a);
    vec3 m = cross(e, a);
    float m_m = dot(m, m), m_o = dot(m, o);
    if (m_m < SMALLEST_SLOPE * SMALLEST_SLOPE) {
        if (dot(p, p) <= radius * radius) return WHOLE;
        return EMPTY;
    }
    float discriminant = radius * radius * m_m - m_o * m_o;
    if (discriminant < 0.0) return EMPTY;
    float middle = -dot(e, p) / m_m, span = sqrt(discriminant) / m_m;
    return Interval(middle - span, middle + span);
}

Interval slab_interval(vec3 o, vec3 d, vec3 a, float half_height) {
    float d_a = dot(d, a), o_a = dot(o, a);
    if (abs(d_a) < SMALLEST_SLOPE) {
        if (abs(o_a) <= half_height) return WHOLE;
        return EMPTY;
    }
    float middle = -o_a / d_a, span = half_height / abs(d_a);
    return Interval(middle - span, middle + span);
}

void main() {
    vec3 o, d;
    ray_of_fragment(gl_FragCoord.xy, o, d);
    // Started near the point of the axis nearest to the camera, a ray that comes from
    // afar loses nothing by distance.
    float half_height = height / 2.0;
    float level = clamp(dot(o - center, axis), -half_height, half_height);
    float foot = dot(center + axis * level - o, d) / dot(d, d);
    if (foot <= radius) foot = 0.0;
    vec3 near = o - center + d * foot;
    Interval wall = wall_interval(near, d, axis, radius);
    Interval slab = slab_interval(near, d, axis, half_height);
    float enter = foot + max(wall.lower, slab.lower);
    float leave = foot + min(wall.upper, slab.upper);
    if (!(enter <= leave && leave > 0.0)) discard;
    bool outside = enter > 0.0;
    bool on_cap = outside ? slab.lower > wall.lower : slab.upper < wall.upper;
    float t = outside ? enter : leave;

    vec3 p = o + d * t, q = p - center;
    vec3 n = on_cap ? axis : normalize(q - axis * dot(q, axis));
    if (dot(n, d) > 0.0) n = -n;
    position = vec4(p, float(index));
    normal = vec4(n, on_cap ? 1.0 : 0.0);
    gl_FragDepth = window_depth(p.z);
}

#endif
