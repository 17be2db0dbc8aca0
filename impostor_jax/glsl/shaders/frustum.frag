// First surface of a frustum, or a sector of it, on the ray of a pixel.
//
// A ray enters and leaves wall and slab together, and crosses the two faces of the cut;
// the first of these in front of the camera that is there, and in the sector, is seen.
// Formulas and names are those of primitives/frustum.py, tapered.py and sector.py.
// Fields: p1, p2, axis, radius1, radius2; start and end, the unit normals of the cut's
// faces; is_sector, caps and cut_faces, each 0 or 1.

const int WALL = 0, LOW_CAP = 1, HIGH_CAP = 2, START_FACE = 3, END_FACE = 4;

// Keep a crossing that is there, in front, and nearer than the one kept.
void keep(float at, int given, bool is_there, inout float t, inout int part) {
    if (is_there && at > 0.0 && at < t) {
        t = at;
        part = given;
    }
}

// The side of a plane through 0 that n points to.
Interval half_space(vec3 o, vec3 d, vec3 n) {
    float level = dot(o, n), speed = dot(d, n);
    if (abs(speed) < SMALLEST_SLOPE) {
        if (level >= 0.0) return WHOLE;
        return EMPTY;
    }
    float crossing = -level / speed;
    if (speed > 0.0) return Interval(crossing, INFINITE);
    return Interval(-INFINITE, crossing);
}

// A convex sector holds the ray on the stretch, any other one off it.
bool holds(bool is_convex, Interval stretch, float t) {
    return is_convex ? stretch.lower <= t && t <= stretch.upper
                     : !(stretch.lower < t && t < stretch.upper);
}

// A ray and the whole body, counted from a point of the axis.
struct Passage {
    vec3 anchor;
    float slope;
    vec3 near;
    float foot;  // less the parameter that comes first
    float enter;
    float leave;
    int into;
    int out_of;
};

Passage passage(vec3 o, vec3 d) {
    // Counted from the end that is nearer to the camera, with the radius of that end.
    vec3 a = axis;
    float span = dot(p2 - p1, a), slope = (radius2 - radius1) / span;
    bool second = dot(o - p1, a) > span / 2.0;
    vec3 anchor = second ? p2 : p1;
    float low = second ? -span : 0.0, high = second ? 0.0 : span;
    float radius = second ? radius2 : radius1;
    float at_low = radius + slope * low, at_high = radius + slope * high;
    float widest = max(at_low, at_high), foot;
    float level = clamp(dot(o - anchor, a), low, high);
    vec3 near = brought_near(o, d, anchor, anchor + a * level, widest, foot);

    Interval wall = cone_interval(near, d, a, radius, slope);
    Interval slab = plane_interval(near, d, a, low, high);
    bool rises = dot(d, a) > 0.0;
    // An end that is a point, to rounding, has no cap.
    float least = 4.0 * EPS * widest;
    bool has_low = at_low > least, has_high = at_high > least;
    bool into_cap = slab.lower > wall.lower && (rises ? has_low : has_high);
    bool out_of_cap = slab.upper < wall.upper && (rises ? has_high : has_low);
    return Passage(
        anchor, slope, near, foot,
        max(wall.lower, slab.lower), min(wall.upper, slab.upper),
        into_cap ? (rises ? LOW_CAP : HIGH_CAP) : WALL,
        out_of_cap ? (rises ? HIGH_CAP : LOW_CAP) : WALL
    );
}

// A ray and the sector.
struct Cut {
    bool is_convex;
    Interval stretch;  // in the smaller of the sector and the rest of the turn
    int begins;
    int finishes;
};

Cut cut_of(vec3 near, vec3 d) {
    bool is_convex = dot(cross(start, end), axis) >= 0.0;
    Interval first = half_space(near, d, is_convex ? start : -start);
    Interval after = half_space(near, d, is_convex ? -end : end);
    return Cut(
        is_convex,
        Interval(max(first.lower, after.lower), min(first.upper, after.upper)),
        first.lower > after.lower ? START_FACE : END_FACE,
        first.upper < after.upper ? START_FACE : END_FACE
    );
}

// Of a part of the surface at a point relative to one of the axis.
vec3 normal_of(vec3 q, int part, float slope) {
    vec3 a = axis;
    vec3 n = part == LOW_CAP ? -a : part == HIGH_CAP ? a
           : part == START_FACE ? -start : end;
    if (part == WALL) {
        vec3 radial = q - a * dot(q, a);
        float out_of_axis = length(radial);
        // The point of a cone has no direction from the axis.
        n = (out_of_axis > 0.0 ? radial / out_of_axis : vec3(0.0)) - a * slope;
    }
    return normalize(n);
}

Surface intersect(vec3 o, vec3 d) {
    Passage whole = passage(o, d);
    float enter = whole.enter, leave = whole.leave, foot = whole.foot;
    if (!(enter <= leave)) return MISS;
    bool enters = caps > 0.5 || whole.into == WALL;
    bool leaves = caps > 0.5 || whole.out_of == WALL;

    float t = INFINITE;
    int part = WALL;
    Cut cut = Cut(true, WHOLE, END_FACE, END_FACE);
    if (is_sector > 0.5) {
        cut = cut_of(whole.near, d);
        enters = enters && holds(cut.is_convex, cut.stretch, enter);
        leaves = leaves && holds(cut.is_convex, cut.stretch, leave);
    }
    keep(foot + enter, whole.into, enters, t, part);
    keep(foot + leave, whole.out_of, leaves, t, part);
    if (is_sector * cut_faces > 0.5 && cut.stretch.lower <= cut.stretch.upper) {
        float at = cut.stretch.lower;
        keep(foot + at, cut.begins, enter < at && at < leave, t, part);
        at = cut.stretch.upper;
        keep(foot + at, cut.finishes, enter < at && at < leave, t, part);
    }
    if (t >= INFINITE) return MISS;
    vec3 n = normal_of(o + d * t - whole.anchor, part, whole.slope);
    return Surface(t, facing(n, d), part);
}
