// Stretches of a ray in the closed solid, one or, of a sector, two.

End end_of(Passage whole, vec3 d, float at, int part) {
    vec3 n = normal_of(whole.near + d * at, part, whole.slope);
    return End(whole.foot + at, part, abs(dot(n, d)));
}

Stretch between(Passage whole, vec3 d, float enter, int into, float leave, int out_of) {
    if (!(enter <= leave)) return NOWHERE;
    return Stretch(end_of(whole, d, enter, into), end_of(whole, d, leave, out_of));
}

Stretch stretches(vec3 o, vec3 d, out Stretch again) {
    Passage whole = passage(o, d);
    float enter = whole.enter, leave = whole.leave;
    again = NOWHERE;
    if (is_sector < 0.5) return between(whole, d, enter, whole.into, leave, whole.out_of);
    Cut cut = cut_of(whole.near, d);
    float low = cut.stretch.lower, high = cut.stretch.upper;
    // Of less than half a turn what lies between the faces, or else all but that.
    if (cut.is_convex) {
        bool starts_in = low > enter, stops_in = high < leave;
        return between(
            whole, d, starts_in ? low : enter, starts_in ? cut.begins : whole.into,
            stops_in ? high : leave, stops_in ? cut.finishes : whole.out_of
        );
    }
    if (!(low <= high)) low = high = INFINITE;
    bool stops_in = low < leave, starts_in = high > enter;
    again = between(
        whole, d, starts_in ? high : enter, starts_in ? cut.finishes : whole.into,
        leave, whole.out_of
    );
    return between(
        whole, d, enter, whole.into,
        stops_in ? low : leave, stops_in ? cut.begins : whole.out_of
    );
}

vec3 normal_at(vec3 p, int part) {
    return normal_of(p - p1, part, (radius2 - radius1) / dot(p2 - p1, axis));
}
