// Stretches of a ray in the ground, which goes down without end.
//
// Beside the extent, which is no surface of its own, a stretch goes on without an end: there
// are planes that cut it. Of more crossings than four the ray sees the first four.

const int MOST_CROSSINGS = 4;

// The patch of a point, as near as there is one, and the place in it.
ivec2 cell_of(vec3 p, out vec2 at) {
    at = clamp(((p - center) * rotation).xz * patches / size.xz + patches / 2.0,
               vec2(0.0), patches);
    ivec2 cell = clamp(ivec2(floor(at)), ivec2(0), ivec2(patches) - 1);
    at -= vec2(cell);
    return cell;
}

vec3 normal_at(vec3 p, int part) {
    vec2 at;
    ivec2 cell = cell_of(p, at);
    return upward(cell, at);
}

Stretch stretches(vec3 o, vec3 d, out Stretch again) {
    float speed = length(d), ts[MOST_CROSSINGS], slopes[MOST_CROSSINGS];
    // Before all of it, wherever the origin is.
    float start = -(length(o - center) + length(size)) / speed, t = start;
    bool is_open = true;
    for (int k = 0; k < MOST_CROSSINGS; k++) {
        ts[k] = INFINITE;
        slopes[k] = 0.0;
        float ahead = is_open ? intersect(o + d * t, d).t : INFINITE;
        is_open = ahead < INFINITE;
        if (is_open) {
            ts[k] = t + ahead;
            slopes[k] = dot(normal_at(o + d * ts[k], 0), d);
            // Off the surface by the rounding of where it was found: there and back again.
            float room = 4.0 * EPS * (length(o) + (abs(t) + abs(ahead)) * speed);
            t = ts[k] + (slopes[k] == 0.0 ? 0.0 : room / abs(slopes[k]));
        }
    }
    // Whether the ray begins below is told by how it first crosses, or where it never
    // does, by any place.
    bool begins_below = slopes[0] > 0.0;
    if (ts[0] >= INFINITE) {
        Interval x = slab_interval(o - center, d, rotation[0], size.x / 2.0);
        Interval z = slab_interval(o - center, d, rotation[2], size.z / 2.0);
        float begin = max(max(x.lower, z.lower), start), finish = min(x.upper, z.upper);
        float middle = begin < finish ? (begin + finish) / 2.0 : begin;
        vec3 p = o + d * (abs(middle) < 1e30 ? middle : 0.0);
        vec2 at;
        ivec2 cell = cell_of(p, at);
        begins_below = dot(p - center, rotation[1]) < surface(cell, at).x;
    }
    End first = End(ts[0], 0, abs(slopes[0])), second = End(ts[1], 0, abs(slopes[1]));
    End third = End(ts[2], 0, abs(slopes[2])), fourth = End(ts[3], 0, abs(slopes[3]));
    Stretch found = Stretch(first, second);
    again = Stretch(third, fourth);
    if (begins_below) {
        found = Stretch(End(-INFINITE, 0, 0.0), first);
        again = Stretch(second, third);
    }
    // Of what begins at no place there is nothing.
    if (found.enter.t >= INFINITE) found = NOWHERE;
    if (again.enter.t >= INFINITE) again = NOWHERE;
    return found;
}
