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

Surface intersect(vec3 o, vec3 d) {
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
    float enter = max(wall.lower, slab.lower), leave = min(wall.upper, slab.upper);
    if (!(enter <= leave)) return MISS;
    bool rises = dot(d, a) > 0.0;
    // An end that is a point, to rounding, has no cap.
    float least = 4.0 * EPS * widest;
    bool has_low = at_low > least, has_high = at_high > least;
    bool into_cap = slab.lower > wall.lower && (rises ? has_low : has_high);
    bool out_of_cap = slab.upper < wall.upper && (rises ? has_high : has_low);
    int cap_in = rises ? LOW_CAP : HIGH_CAP, cap_out = rises ? HIGH_CAP : LOW_CAP;
    bool enters = caps > 0.5 || !into_cap, leaves = caps > 0.5 || !out_of_cap;

    float t = INFINITE;
    int part = WALL;
    Interval first = WHOLE, after = WHOLE, stretch = WHOLE;
    if (is_sector > 0.5) {
        bool is_convex = dot(cross(start, end), a) >= 0.0;
        first = half_space(near, d, is_convex ? start : -start);
        after = half_space(near, d, is_convex ? -end : end);
        stretch = Interval(max(first.lower, after.lower), min(first.upper, after.upper));
        enters = enters && holds(is_convex, stretch, enter);
        leaves = leaves && holds(is_convex, stretch, leave);
    }
    keep(foot + enter, into_cap ? cap_in : WALL, enters, t, part);
    keep(foot + leave, out_of_cap ? cap_out : WALL, leaves, t, part);
    if (is_sector * cut_faces > 0.5 && stretch.lower <= stretch.upper) {
        float at = stretch.lower;
        int face = first.lower > after.lower ? START_FACE : END_FACE;
        keep(foot + at, face, enter < at && at < leave, t, part);
        at = stretch.upper;
        face = first.upper < after.upper ? START_FACE : END_FACE;
        keep(foot + at, face, enter < at && at < leave, t, part);
    }
    if (t >= INFINITE) return MISS;

    vec3 q = o + d * t - anchor;
    vec3 n = part == LOW_CAP ? -a : part == HIGH_CAP ? a
           : part == START_FACE ? -start : end;
    if (part == WALL) {
        vec3 radial = q - a * dot(q, a);
        float out_of_axis = length(radial);
        // The point of a cone has no direction from the axis.
        n = (out_of_axis > 0.0 ? radial / out_of_axis : vec3(0.0)) - a * slope;
    }
    return Surface(t, facing(normalize(n), d), part);
}
