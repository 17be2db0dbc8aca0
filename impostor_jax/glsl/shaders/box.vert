// Billboard of a box: a rectangle that is tight to the images of its corners.
//
// It lies along the edges that are seen longest. Fields: center, rotation, size.

vec2 longer(vec2 v, vec2 w) {
    return dot(v, v) >= dot(w, w) ? v : w;
}

vec4 billboard(vec2 corner) {
    mat3 edges = mat3(rotation[0] * size.x, rotation[1] * size.y, rotation[2] * size.z);
    vec2 along = direction_of(longer(
        longer(seen_axis(center, edges[0]), seen_axis(center, edges[1])),
        seen_axis(center, edges[2])
    ));
    vec2 n = corner.x * along, m = corner.y * vec2(-along.y, along.x);
    float ahead = -1e38, beside = -1e38;
    bool in_front = true;
    for (int k = 0; k < 8; k++) {
        vec3 side = vec3(k & 1, (k >> 1) & 1, k >> 2) - 0.5;
        vec3 p = center + edges * side;
        in_front = in_front && point_in_front(p);
        ahead = max(ahead, dot(n, seen_point(p)));
        beside = max(beside, dot(m, seen_point(p)));
    }
    return clip_of_rectangle(corner, n, ahead, m, beside, in_front);
}
