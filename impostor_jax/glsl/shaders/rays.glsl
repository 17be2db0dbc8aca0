// Rays and the stretch of a ray that lies in a convex solid; formulas and names are those
// of geometry/rays.py and primitives/surface.py.

const float INFINITE = 3e38;

struct Interval {
    float lower;
    float upper;
};

const Interval EMPTY = Interval(INFINITE, -INFINITE);
const Interval WHOLE = Interval(-INFINITE, INFINITE);

// Where a ray first meets a primitive: o + d t, with a unit normal.
struct Surface {
    float t;
    vec3 normal;
    int part;  // as the primitive counts them from 0
};

const Surface MISS = Surface(INFINITE, vec3(0.0), 0);

// The normal turned against the ray.
vec3 facing(vec3 n, vec3 d) {
    return dot(n, d) > 0.0 ? -n : n;
}

// The ray's origin relative to center, moved along it by foot: started near the target,
// a ray that comes from afar loses nothing by distance.
vec3 brought_near(vec3 o, vec3 d, vec3 center, vec3 target, float radius, out float foot) {
    foot = dot(target - o, d) / dot(d, d);
    if (foot <= radius) foot = 0.0;
    return o - center + d * foot;
}

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

// One nappe of a cone; of the roots, the one that cancels is made from their product.
Interval cone_interval(vec3 o, vec3 d, vec3 a, float radius, float slope) {
    float o_a = dot(o, a), d_a = dot(d, a);
    // Turned by a right angle about the axis, which removes what is left along it.
    vec3 m = cross(d - a * d_a, a), p = cross(o - a * o_a, a);
    float rho = radius + slope * o_a, k = slope * d_a;
    float m_o = dot(m, o), m_m = dot(m, m), beside = dot(p, p) - rho * rho;
    // Along the axis of a cylinder there is no root.
    if (m_m < SMALLEST_SLOPE * SMALLEST_SLOPE && k == 0.0) {
        if (beside <= 0.0) return WHOLE;
        return EMPTY;
    }
    vec3 w = m * rho - p * k;
    float discriminant = dot(w, w) - m_o * m_o, size = sqrt(m_m);
    float opening = (size - k) * (size + k);
    if (!(opening < 0.0 || discriminant >= 0.0)) return EMPTY;
    float root = sqrt(max(discriminant, 0.0)), half_sum = dot(p, m) - rho * k;
    float total = -(half_sum < 0.0 ? half_sum - root : half_sum + root);
    // Both roots are 0 without a linear part.
    float first = 0.0, second = 0.0;
    if (total != 0.0) {
        first = beside / total;
        second = opening != 0.0 ? total / opening
                                : total < 0.0 ? -INFINITE : INFINITE;
    }
    float low = min(first, second), high = max(first, second);
    if (opening >= 0.0) return Interval(low, high);
    if (k > 0.0) return Interval(high, INFINITE);
    return Interval(-INFINITE, low);
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

Interval plane_interval(vec3 o, vec3 d, vec3 a, float low, float high) {
    float d_a = dot(d, a), o_a = dot(o, a);
    if (abs(d_a) < SMALLEST_SLOPE) {
        if (low <= o_a && o_a <= high) return WHOLE;
        return EMPTY;
    }
    float first = (low - o_a) / d_a, second = (high - o_a) / d_a;
    return Interval(min(first, second), max(first, second));
}

Interval ball_interval(vec3 o, vec3 d, float radius) {
    vec3 m = cross(o, d);
    float d_d = dot(d, d);
    float discriminant = radius * radius * d_d - dot(m, m);
    if (discriminant < 0.0) return EMPTY;
    float middle = -dot(o, d) / d_d, span = sqrt(discriminant) / d_d;
    return Interval(middle - span, middle + span);
}
