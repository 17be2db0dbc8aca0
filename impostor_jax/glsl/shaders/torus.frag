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

// Half the slope of the squared distance from the center line, and its own, where
// sine x - lag is beside: near the axis the difference has no digits.
vec2 past_by(Line line, float x, float beside) {
    float square = beside * beside + line.apart * line.apart;
    float inverse = square > 0.0 ? inversesqrt(square) : 0.0;
    float across = line.sine * line.apart * inverse;
    return vec2(x - line.sine * beside * inverse, 1.0 - across * across * inverse);
}

vec2 past(Line line, float x) {
    return past_by(line, x, line.sine * x - line.lag);
}

float distance_at(Line line, float x) {
    float beside = length(vec2(line.sine * x - line.lag, line.apart)) - 1.0;
    return length(vec2(beside, line.height + line.rise * x));
}

// A place where that is smallest, by Newton's steps from x.
float smallest(Line line, float x, float low, float high) {
    for (int k = 0; k < STEPS; k++) {
        vec2 now = past(line, x);
        x = clamp(now.y != 0.0 ? x - now.x / now.y : x, low, high);
    }
    return x;
}

// Where it is largest, by steps of sine x - lag from 0.
float largest_after(Line line, float middle) {
    float beside = 0.0, most = line.sine * line.sine - line.lag;
    for (int k = 0; k < STEPS; k++) {
        vec2 now = past_by(line, middle + beside / line.sine, beside);
        if (now.y != 0.0) beside -= line.sine * now.x / now.y;
        beside = clamp(beside, 0.0, most);
    }
    return middle + beside / line.sine;
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

// A ray past a torus of major radius 1, by its length from its origin on.
struct Past {
    vec3 o;
    vec3 d;
    float r;           // minor radius
    vec3 at;           // nearest to the center line, farthest after it, nearest again
    vec3 off;          // distances from the center line there
    vec2 curvature;    // of the squared distance, at the first and the last
    float begin;       // before it crosses the surface
    float finish;      // after it has
    float first_t;     // parameter that comes first
    float per_t;
};

Past past_of(vec3 origin, vec3 direction) {
    float first_t;
    vec3 near_origin = brought_near(
        origin, direction, center, center, major_radius + minor_radius, first_t
    );
    float speed = length(direction), per_t = speed / major_radius;
    vec3 o = near_origin / major_radius, d = direction / speed, a = axis;
    float r = minor_radius / major_radius;

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
    float first = smallest(line, -sine, -sine, 0.0), largest = first, second = first;
    if (s < 1.0 && line.lag < sine * sine * pow((1.0 - s) * (1.0 + s), 1.5)) {
        largest = largest_after(line, middle);
        second = smallest(line, sine, middle, sine);
    }
    float near = lag < 0.0 ? second : first, far = lag < 0.0 ? first : second;
    vec3 off = vec3(
        distance_at(line, near), distance_at(line, largest), distance_at(line, far)
    );
    vec2 curvature = vec2(past(line, near).y, past(line, far).y);
    float reach = sqrt(max((1.0 + r) * (1.0 + r) - dot(p, p), 0.0)) * 1.000001;
    return Past(
        o, d, r, foot + turn * vec3(near, largest, far), off, curvature,
        foot - reach, foot + reach, first_t, per_t
    );
}

// From the nearest place to where the parabola of the squared distance crosses.
float half_chord(Past path, bool by_near) {
    float least = by_near ? path.off.x : path.off.z;
    float curvature = by_near ? path.curvature.x : path.curvature.y;
    return sqrt(max((path.r - least) * (path.r + least) / max(curvature, 1e-30), 0.0));
}

// Where the ray crosses the surface, from about there, by Newton's steps; between a place
// where it has not and one where it has.
float crossing(Past path, float u, float low, float high, bool leaves) {
    u = clamp(u, low, high);
    for (int k = 0; k < STEPS; k++) {
        vec2 now = gap(path.o, path.d, axis, path.r, u);
        if ((now.x > 0.0) != leaves) low = u; else high = u;
        float ahead = now.y != 0.0 ? u - now.x / now.y : u;
        u = low <= ahead && ahead <= high ? ahead : (low + high) / 2.0;
    }
    return u;
}

vec3 normal_at(vec3 p, int part) {
    vec3 q = p - center;
    vec3 aside = q - axis * dot(q, axis);
    return normalize(q - normalize(aside) * major_radius);
}

Surface intersect(vec3 origin, vec3 direction) {
    Past path = past_of(origin, direction);
    vec3 at = path.at, off = path.off;
    float r = path.r, start = -path.first_t * path.per_t;
    bool is_inside = start == 0.0 && gap(path.o, path.d, axis, r, 0.0).x < 0.0;
    bool enters_near = !is_inside && at.x > start && off.x <= r;
    bool enters_far = !is_inside && at.z > start && off.z <= r;
    bool leaves_near = is_inside && at.y > start && off.y > r;
    if (!(is_inside || enters_near || enters_far)) return MISS;
    bool by_near = enters_near || leaves_near;
    float low = by_near ? (is_inside ? at.x : path.begin) : (is_inside ? at.z : at.y);
    float high = by_near ? (is_inside ? at.y : at.x) : (is_inside ? path.finish : at.z);
    low = max(low, start);
    float aside = half_chord(path, by_near);
    float u = (by_near ? at.x : at.z) + (is_inside ? aside : -aside);
    u = crossing(path, u, low, high, is_inside);
    float t = max(path.first_t + u / path.per_t, 1e-37);
    return Surface(t, facing(normal_at(origin + direction * t, 0), direction), 0);
}
