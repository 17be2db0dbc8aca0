// First surface of a torus on the ray of a pixel.
//
// The distance of the ray's points from the ring's center line has one smallest value, or
// two with a largest between them; the crossing is closed in on between these places.
// Formulas and names are those of primitives/torus.py. Fields: center, axis,
// major_radius, minor_radius; radius and height of the cylinder around it.

const int STEPS = 11;

// A ray in major radii, by its place x after the point nearest to the center; turned so
// that lag is not negative.
struct Line {
    float sine;
    float lag;
    float apart;
    float height;
    float rise;
};

// Half the slope of the squared distance from the center line, and its own.
vec2 past(Line line, float x) {
    float along = line.sine * x - line.lag;
    float square = along * along + line.apart * line.apart;
    float inverse = square > 0.0 ? inversesqrt(square) : 0.0;
    float across = line.sine * line.apart * inverse;
    return vec2(x - line.sine * along * inverse, 1.0 - across * across * inverse);
}

float distance_at(Line line, float x) {
    float beside = length(vec2(line.sine * x - line.lag, line.apart)) - 1.0;
    return length(vec2(beside, line.height + line.rise * x));
}

// One of the places where that is smallest or largest, by Newton's steps from x.
float extreme(Line line, float x, float low, float high) {
    for (int k = 0; k < STEPS; k++) {
        vec2 now = past(line, x);
        x = clamp(now.y != 0.0 ? x - now.x / now.y : x, low, high);
    }
    return x;
}

// Distance from the surface of major radius 1 and minor radius r, and its slope.
vec2 gap(vec3 o, vec3 d, vec3 a, float r, float u) {
    vec3 q = o + d * u;
    float along = dot(q, a);
    vec3 aside = q - a * along;
    float rho = length(aside), beside = rho - 1.0;
    float off = length(vec2(beside, along));
    float slope = along * dot(d, a);
    if (rho > 0.0) slope += beside * dot(aside, d) / rho;
    return vec2(off - r, off > 0.0 ? slope / off : 0.0);
}

Surface intersect(vec3 origin, vec3 direction) {
    float first_t;
    vec3 near_origin = brought_near(
        origin, direction, center, center, major_radius + minor_radius, first_t
    );
    float speed = length(direction), per_t = speed / major_radius;
    vec3 o = near_origin / major_radius, d = direction / speed, a = axis;
    float r = minor_radius / major_radius, start = -first_t * per_t;

    float foot = -dot(o, d), rise = dot(d, a);
    vec3 p = o + d * foot;
    float height = dot(p, a);
    vec3 m = cross(d - a * rise, a);
    float sine = length(m);
    bool is_along = sine < SMALLEST_SLOPE;
    if (!is_along) m /= sine;
    float lag = -dot(p, cross(a, m)), turn = lag < 0.0 ? -1.0 : 1.0;
    float apart = is_along ? length(p - a * height) : abs(dot(p, m));
    Line line = Line(sine, lag * turn, apart, height, rise * turn);

    float middle = sine > 0.0 ? line.lag / sine : 0.0;
    float s = sine > 0.0 ? pow(apart / (sine * sine), 1.0 / 3.0) : 0.0;
    float first = extreme(line, -sine, -sine, 0.0), largest = first, second = first;
    if (s < 1.0 && line.lag < sine * sine * pow((1.0 - s) * (1.0 + s), 1.5)) {
        largest = extreme(line, middle, middle, sine);
        second = extreme(line, sine, middle, sine);
    }
    float near = lag < 0.0 ? second : first, far = lag < 0.0 ? first : second;
    vec3 off = vec3(
        distance_at(line, near), distance_at(line, largest), distance_at(line, far)
    );
    vec3 at = foot + turn * vec3(near, largest, far);

    bool is_inside = start == 0.0 && gap(o, d, a, r, 0.0).x < 0.0;
    bool enters_near = !is_inside && at.x > start && off.x <= r;
    bool enters_far = !is_inside && at.z > start && off.z <= r;
    bool leaves_near = is_inside && at.y > start && off.y > r;
    if (!(is_inside || enters_near || enters_far)) return MISS;
    bool by_near = enters_near || leaves_near;
    float reach = sqrt(max((1.0 + r) * (1.0 + r) - dot(p, p), 0.0)) * 1.000001;
    float low = by_near ? (is_inside ? at.x : foot - reach) : (is_inside ? at.z : at.y);
    float high = by_near ? (is_inside ? at.y : at.x) : (is_inside ? foot + reach : at.z);
    low = max(low, start);

    // Where the parabola of the squared distance crosses; then by Newton's steps.
    float least = by_near ? off.x : off.z, curvature = past(line, by_near ? near : far).y;
    float half_chord = sqrt(max((r - least) * (r + least) / max(curvature, 1e-30), 0.0));
    float u = (by_near ? at.x : at.z) + (is_inside ? half_chord : -half_chord);
    u = clamp(u, low, high);
    for (int k = 0; k < STEPS; k++) {
        vec2 now = gap(o, d, a, r, u);
        if ((now.x > 0.0) != is_inside) low = u; else high = u;
        float ahead = now.y != 0.0 ? u - now.x / now.y : u;
        u = low <= ahead && ahead <= high ? ahead : (low + high) / 2.0;
    }
    float t = max(first_t + u / per_t, 1e-37);
    vec3 q = origin + direction * t - center;
    vec3 aside = q - axis * dot(q, axis);
    return Surface(t, facing(normalize(q - normalize(aside) * major_radius), direction),
                   0);
}
