//! Words by which a link names whom it refuses and what it lost, for who looks for them.

/// Words for a refused certificate.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Refusal {
    /// Of the side that refuses it.
    pub by: &'static str,
    /// Of the side that is refused.
    pub of: &'static str,
}

/// A certificate of an authority that the other side does not trust.
pub const FOREIGN: Refusal = Refusal {
    by: "its certificate is of another authority",
    of: "it does not know the authority of this certificate",
};
/// A certificate that is too old. The side that is refused is not told whether it is too young.
pub const EXPIRED: Refusal = Refusal {
    by: "its certificate has expired",
    of: "for its clock this certificate is not valid now",
};
/// No certificate.
pub const NO_CERTIFICATE: Refusal = Refusal {
    by: "it shows no certificate",
    of: "it was shown no certificate",
};
/// A station's word for a link that is made: controllers' hosts follow.
pub const LINKED_FROM: &str = "is linked from";
/// A station's word for a link that is no more.
pub const ENDED: &str = "has ended";
/// A controller's word for a link that is no more.
pub const LOST: &str = "was lost; it is called again";
