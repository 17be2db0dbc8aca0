// Billboard of a sphere: a rectangle that is tight to its outline.
//
// The sphere's tangents from the camera form a cone, whose section with the plane z = 1
// is an ellipse with one axis towards the principal point. Fields: center, radius.

#ifdef ORTHOGRAPHIC

float ball_support(vec2 n, vec3 c, float r) {
    return dot(n, c.xy) + r;
}

bool in_front(vec3 c, float r) {
    return true;
}

#else

// Largest n.x over the outline in the plane z = 1: the plane through the camera and the
// line n.x = s is r away from the center, (n.c - s c.z)^2 = r^2 (1 + s^2).
float ball_support(vec2 n, vec3 c, float r) {
    float n_c = dot(n, c.xy), square = (c.z - r) * (c.z + r);
    return (n_c * c.z + r * sqrt(max(n_c * n_c + square, 0.0))) / square;
}

bool in_front(vec3 c, float r) {
    return c.z > r;
}

#endif

vec4 billboard(vec2 corner) {
    vec2 along = direction_of(center.xy);
    vec2 n = corner.x * along, m = corner.y * vec2(-along.y, along.x);
    float ahead = ball_support(n, center, radius);
    float beside = ball_support(m, center, radius);
    return clip_of_rectangle(
        corner, n, ahead, m, beside, in_front(center, radius)
    );
}
