bool inside(vec3 p) {
    return all(lessThan(abs((p - center) * rotation), size / 2.0));
}
