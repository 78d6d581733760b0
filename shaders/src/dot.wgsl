// Sums over all invocations: a workgroup adds up its own here, `total` those of all. The order is
// fixed, so that the same input gives the same bits.

override with_dot: bool = true;

var<workgroup> strip: array<vec4<f32>, 64>;

// Leaves the workgroup's sums of `own` in partials, `kept` of them: invocations that are that far
// apart belong together. To be called by all invocations.
fn add_up(at: Invocation, own: vec4<f32>, kept: u32) {
    if !with_dot {
        return;
    }
    strip[at.local] = own;
    for (var half = 32u; half >= kept; half /= 2u) {
        workgroupBarrier();
        if at.local < half {
            strip[at.local] += strip[at.local + half];
        }
    }
    workgroupBarrier();
    if at.local < kept {
        let number = (at.group.z * at.groups.y + at.group.y) * at.groups.x + at.group.x;
        partials[number * kept + at.local] = strip[at.local];
    }
}
