// Stretches of a ray in the ring, of which one or both may be empty.

End end_of_ring(Past path, float speed, bool by_near, bool leaves, float low, float high) {
    float aside = half_chord(path, by_near);
    float u = (by_near ? path.at.x : path.at.z) + (leaves ? aside : -aside);
    u = crossing(path, u, low, high, leaves);
    float slope = abs(gap(path.o, path.d, axis, path.r, u).y) * speed;
    return End(path.first_t + u / path.per_t, 0, slope);
}

Stretch stretches(vec3 o, vec3 d, out Stretch again) {
    Past path = past_of(o, d);
    vec3 at = path.at;
    bool in_near = path.off.x <= path.r, in_middle = path.off.y <= path.r;
    bool in_far = path.off.z <= path.r;
    float speed = length(d);
    Stretch found = NOWHERE;
    again = NOWHERE;
    if (!(in_near || in_far)) return found;
    End out_of_far = end_of_ring(path, speed, false, true, at.z, path.finish);
    // Where it does not come out between, the first stretch is all.
    if (in_near) {
        found.enter = end_of_ring(path, speed, true, false, path.begin, at.x);
        found.leave = out_of_far;
        if (!in_middle) {
            found.leave = end_of_ring(path, speed, true, true, at.x, at.y);
        }
    }
    if (in_far && !in_middle) {
        again = Stretch(end_of_ring(path, speed, false, false, at.y, at.z), out_of_far);
    }
    return found;
}
