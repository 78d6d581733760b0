// Adds up what the workgroups of a kernel left, onto what is there already. One workgroup.

@group(1) @binding(0) var<storage, read> sums: array<vec4<f32>>;
@group(1) @binding(1) var<storage, read_write> totals: array<vec4<f32>>;

var<workgroup> strip: array<vec4<f32>, 256>;

fn total(local: u32) -> vec4<f32> {
    var own = vec4(0.0);
    for (var i = local; i < arrayLength(&sums); i += 256u) {
        own += sums[i];
    }
    strip[local] = own;
    for (var half = 128u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if local < half {
            strip[local] += strip[local + half];
        }
    }
    workgroupBarrier();
    return strip[0];
}

@compute @workgroup_size(256)
fn add_of_radiance(@builtin(local_invocation_index) local: u32) {
    let sum = total(local);
    if local == 0u {
        totals[0] += sum;
    }
}

@compute @workgroup_size(256)
fn add_of_misfit(@builtin(local_invocation_index) local: u32) {
    let sum = total(local);
    if local == 0u {
        totals[1] += sum;
    }
}

@compute @workgroup_size(256)
fn add_of_smoothness(@builtin(local_invocation_index) local: u32) {
    let sum = total(local);
    if local == 0u {
        totals[2] += sum;
    }
}
