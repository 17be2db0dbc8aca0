// Billboard of a triangle: a rectangle that is tight to the images of its corners.
//
// It lies along the edge that is seen longest. Fields: corners, in columns.

vec2 longer(vec2 v, vec2 w) {
    return dot(v, v) >= dot(w, w) ? v : w;
}

vec4 billboard(vec2 corner) {
    vec2 x = seen_point(corners[0]), y = seen_point(corners[1]);
    vec2 z = seen_point(corners[2]);
    vec2 along = direction_of(longer(longer(y - x, z - y), x - z));
    vec2 n = corner.x * along, m = corner.y * vec2(-along.y, along.x);
    float ahead = max(max(dot(n, x), dot(n, y)), dot(n, z));
    float beside = max(max(dot(m, x), dot(m, y)), dot(m, z));
    bool in_front = point_in_front(corners[0]) && point_in_front(corners[1])
        && point_in_front(corners[2]);
    return clip_of_rectangle(corner, n, ahead, m, beside, in_front);
}
