bool inside(vec3 p) {
    return length(p - center) < radius;
}
