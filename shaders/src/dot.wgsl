// Sums over all cells, lane by lane: a workgroup adds up its own here, `scalars` those of all.
// The order is fixed, so that the same input gives the same bits.

override with_dot: bool = true;

var<workgroup> strip: array<vec4<f32>, 64>;

// Leaves the workgroup's sum of `own` in partials; to be called by all of its invocations.
fn add_up(local: u32, group: vec3<u32>, groups: vec3<u32>, own: vec4<f32>) {
    if !with_dot {
        return;
    }
    strip[local] = own;
    for (var half = 32u; half >= level.quads; half /= 2u) {
        workgroupBarrier();
        if local < half {
            strip[local] += strip[local + half];
        }
    }
    workgroupBarrier();
    if local < level.quads {
        let number = (group.z * groups.y + group.y) * groups.x + group.x;
        partials[number * level.quads + local] = strip[local];
    }
}
