// Billboard of a frustum, or a sector of it: a rectangle that is tight to the outline of
// the whole one.
//
// As a cylinder's, but that the two end discs have radii of their own. Fields: p1, p2,
// axis, radius1, radius2.

vec4 billboard(vec2 corner) {
    vec2 along = direction_of(seen_axis((p1 + p2) / 2.0, axis));
    vec2 n = corner.x * along, m = corner.y * vec2(-along.y, along.x);
    float ahead = max(disc_support(n, p1, axis, radius1),
                      disc_support(n, p2, axis, radius2));
    float beside = max(disc_support(m, p1, axis, radius1),
                       disc_support(m, p2, axis, radius2));
    bool in_front = disc_in_front(p1, axis, radius1) && disc_in_front(p2, axis, radius2);
    return clip_of_rectangle(corner, n, ahead, m, beside, in_front);
}
