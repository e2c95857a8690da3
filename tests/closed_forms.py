"""Eigenvalues of example models in closed form, and parameters at which they change, in mpmath's digits of the moment.

Values of parameters are numbers or texts; texts count as the decimals that are written. Those of the model files are
the defaults. Zeros are left out.
"""

from mpmath import mp


def pair(square):
    """Return ±√(s²)."""
    root = mp.sqrt(mp.mpc(square))
    return [root, -root]


def numbers(*values):
    return [mp.mpf(value) for value in values]


def pendulum(L="0.2", g="9.81"):
    L, g = numbers(L, g)
    return pair(-3 * g / (4 * L))


def wheeled_inverted_pendulum(**p):
    # Massless-wheel-like elimination of the rolling coordinate: (I + m L² − (m L)²/(m_d + m_p + I_d/R²)) θ'' = m g L θ.
    m_d, R_d, I_d, m_p, L_p, I_p, g = numbers(*(p[x] for x in ("m_d", "R_d", "I_d", "m_p", "L_p", "I_p", "g")))
    effective = I_p + m_p * L_p**2 - (m_p * L_p) ** 2 / (m_d + m_p + I_d / R_d**2)
    return pair(m_p * g * L_p / effective)


def top(omega, H="0.04", m="0.01", I_x="3e-4", I_z="4e-4", g="9.81"):
    # A s² − i C ω s − m g H = 0 for the complex tilt, and its conjugate.
    omega, H, m, I_x, I_z, g = numbers(omega, H, m, I_x, I_z, g)
    A, spin = I_x + m * H**2, 1j * I_z * omega
    root = mp.sqrt(4 * A * m * g * H + spin**2)
    values = [(spin + root) / (2 * A), (spin - root) / (2 * A)]
    return [*values, *(mp.conj(s) for s in values)]


def critical_top(H="0.04", m="0.01", I_x="3e-4", I_z="4e-4", g="9.81"):
    """Return the spin from which the top sleeps."""
    H, m, I_x, I_z, g = numbers(H, m, I_x, I_z, g)
    return 2 * mp.sqrt((I_x + m * H**2) * m * g * H) / I_z


def rolling_disk(omega, R="0.3", m="2", g="9.81", **inertia):
    omega, R, m, g = numbers(omega, R, m, g)
    I_t, I_a = numbers(inertia["I_t"], inertia["I_a"]) if inertia else disk_inertia(R, m)
    return pair((m * g * R * I_t - I_a * (I_a + m * R**2) * omega**2) / (I_t * (I_t + m * R**2)))


def disk_inertia(R, m, W="0.05"):
    """Return the moments of inertia about a diameter and about the axis."""
    (W,) = numbers(W)
    return m * (3 * R**2 + W**2) / 12, m * R**2 / 2


def critical_disk(R="0.3", m="2", g="9.81"):
    """Return the spin from which the disk rolls stably."""
    R, m, g = numbers(R, m, g)
    I_t, I_a = disk_inertia(R, m)
    return mp.sqrt(m * g * R * I_t / (I_a * (I_a + m * R**2)))


def rolling_torus(m, R, r, I_t, I_a, g, v):
    m, R, r, I_t, I_a, g, v = numbers(m, R, r, I_t, I_a, g, v)
    rho = R + r
    return pair((m * g * R * I_t - I_a * (I_a + m * rho**2) * (v / rho) ** 2) / (I_t * (I_t + m * rho**2)))


def rotating_pendulum(Omega):
    (Omega,) = numbers(Omega)
    return pair((mp.mpf("9.81") / (Omega / 2)) ** 2 - Omega**2)


def ziegler(P):
    """Return the eigenvalues of the column without dampers."""
    (P,) = numbers(P)
    root = mp.sqrt(mp.mpc((7 - 2 * P) ** 2 - 8))
    return [s for sign in (1, -1) for s in pair((2 * P - 7 + sign * root) / 4)]


def critical_ziegler():
    """Return the load at which the column without dampers begins to flutter."""
    return mp.mpf(7) / 2 - mp.sqrt(2)


def double_pendulum(g="9.81", **p):
    g, length = numbers(g, p.get("l", "1"))
    return [s for sign in (-1, 1) for s in pair(-(2 + sign * mp.sqrt(2)) * g / length)]


def four_bar(**p):
    # Two rods turn about their ends, the coupler moves with the pins: (2/3 + 1) m l² θ'' = −(1/2 + 1/2 + 1) m g l θ.
    g, length = numbers(p["g"], p["l"])
    return pair(-2 * g / (mp.mpf(5) / 3 * length))


def slider_crank(r, m_c, m_r, k, c):
    # The rod turns with −r/l of the crank about a wrist pin that stands still: its l drops out.
    r, m_c, m_r, k, c = numbers(r, m_c, m_r, k, c)
    J = (m_c + m_r) * r**2 / 3
    root = mp.sqrt(mp.mpc(c**2 - 4 * J * k))
    return [(-c + root) / (2 * J), (-c - root) / (2 * J)]


def chaplygin_sleigh(m, a, v, **p):
    m, a, v, inertia = numbers(m, a, v, p["I"])
    return [-m * a * v / (inertia + m * a**2)]


def trailer(L, v):
    L, v = numbers(L, v)
    return [-v / L]


def free_rigid_body(I1, I2, I3, Omega):
    I1, I2, I3, Omega = numbers(I1, I2, I3, Omega)
    return pair(Omega**2 * (I2 - I1) * (I3 - I2) / (I1 * I3))
