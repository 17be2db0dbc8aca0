// Of the closed solid, whether or not it has caps.
bool inside(vec3 p) {
    vec3 q = p - p1;
    float span = dot(p2 - p1, axis), along = dot(q, axis);
    float wide = radius1 + (radius2 - radius1) * (along / span);
    if (!(0.0 < along && along < span && length(q - axis * along) < wide)) return false;
    if (is_sector < 0.5) return true;
    bool after = dot(q, start) > 0.0, before = dot(q, end) < 0.0;
    return dot(cross(start, end), axis) >= 0.0 ? after && before : after || before;
}
