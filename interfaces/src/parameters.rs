//! Parameters that change while a node runs: what is asked of it, and what it made of that.

use bytemuck::{Pod, Zeroable};
use iceoryx2::prelude::ZeroCopySend;

use crate::{Header, Text};

/// The supervisor asks a node to go on with another value of one parameter.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable, ZeroCopySend)]
#[type_name("SetParameter/2")]
#[repr(C)]
pub struct SetParameter {
    /// Stamp of the request, sequence, epoch of the supervisor.
    pub header: Header,
    /// [-] The dotted key, with its unit at the end.
    pub key: Text,
    /// [as the key says] The value, as somebody would type it: a number, a word, true or false.
    pub value: Text,
}

/// What a node made of such a request.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable, ZeroCopySend)]
#[type_name("ParameterChange/2")]
#[repr(C)]
pub struct ParameterChange {
    /// Stamp of the change, sequence, epoch of the node.
    pub header: Header,
    /// [-] Sequence number of the request.
    pub request: u64,
    /// [-] 1 where the node goes on with it, 0 where it was refused.
    pub accepted: u8,
    /// [-] Zero.
    pub reserved: [u8; 7],
    /// [-] The dotted key.
    pub key: Text,
    /// [as the key says] The value before; empty where there was none.
    pub former: Text,
    /// [as the key says] The value that was asked for.
    pub value: Text,
    /// [-] Why it was refused; else empty.
    pub reason: Text,
}

/// Sizes are part of the agreement: a change is a new type name and a line in the changelog.
const _: () = {
    assert!(size_of::<SetParameter>() == 24 + 2 * Text::CAPACITY);
    assert!(size_of::<ParameterChange>() == 40 + 4 * Text::CAPACITY);
};
