"""Which answer a call gave: ADS return codes and HRESULTs as rows, and the error that carries one.

Rule 1: a code is an unsigned 32-bit int, as the manual prints it (0x98110712). from_signed() and to_signed() convert what
        PLC and C++ hold.
Rule 2: only a negative HRESULT (bit 31 set) is a failure and raises. S_FALSE or ERROR_ALREADY_EXISTS are answers.
Rule 3: a code without a row is still carried, with its number as its name.

Source: EventLogger manual 10.1, with the eight names that its print damaged taken from the TE1000 manual's table 6.1, which
is else the same. Its 5.10.1 prints 0x981170xx for five of them; 10.1's 0x981107xx is right. An ADS code is the low word of
its HRESULT, the high word is 0x9811. ADS_E_X, as the interfaces spell it, is ADSERR_DEVICE_X. The texts are our own.

ERROR_ALREADY_EXISTS is what Create and CreateEx return for an alarm that existed (manual 6.1.5.3). It is the Win32 code 183
itself, not HRESULT_FROM_WIN32 of it (0x800700B7): so it is positive, and the manual lists it beside S_OK as a good answer.
"""

from typing import Final

import msgspec

ADS_FACILITY: Final = 0x9811_0000
"""High word of the HRESULT of an ADS code."""


class Code(msgspec.Struct, frozen=True):
    """One row: the unsigned HRESULT, its name in the manual's table, and what it means in English."""

    code: int
    name: str
    text: str

    @property
    def short_name(self) -> str:
        """The name in the interfaces: ADS_E_X for ADSERR_DEVICE_X, else the name itself."""
        return self.name.replace("ADSERR_DEVICE_", "ADS_E_", 1)

    @property
    def ads_code(self) -> int | None:
        """The ADS return code (0x712), or None when the HRESULT is none of ADS."""
        return self.code & 0xFFFF if self.code & 0xFFFF_0000 == ADS_FACILITY else None


def _ads(code: int, name: str, text: str) -> Code:
    return Code(ADS_FACILITY | code, name, text)


GLOBAL: Final = (
    _ads(0x0000, "ERR_NOERROR", "no error"),
    _ads(0x0001, "ERR_INTERNAL", "internal error"),
    _ads(0x0002, "ERR_NORTIME", "no real time"),
    _ads(0x0003, "ERR_ALLOCLOCKEDMEM", "locked memory could not be allocated"),
    _ads(0x0004, "ERR_INSERTMAILBOX", "mailbox full, the ADS message was not sent; fewer messages per cycle help"),
    _ads(0x0005, "ERR_WRONGRECEIVEHMSG", "wrong HMSG"),
    _ads(0x0006, "ERR_TARGETPORTNOTFOUND", "target port not found: the ADS server is not started or cannot be reached"),
    _ads(0x0007, "ERR_TARGETMACHINENOTFOUND", "target machine not found: no AMS route to it"),
    _ads(0x0008, "ERR_UNKNOWNCMDID", "unknown command id"),
    _ads(0x0009, "ERR_BADTASKID", "invalid task id"),
    _ads(0x000A, "ERR_NOIO", "no I/O"),
    _ads(0x000B, "ERR_UNKNOWNAMSCMD", "unknown AMS command"),
    _ads(0x000C, "ERR_WIN32ERROR", "Win32 error"),
    _ads(0x000D, "ERR_PORTNOTCONNECTED", "port not connected"),
    _ads(0x000E, "ERR_INVALIDAMSLENGTH", "invalid AMS length"),
    _ads(0x000F, "ERR_INVALIDAMSNETID", "invalid AMS Net Id"),
    _ads(0x0010, "ERR_LOWINSTLEVEL", "installation level too low (TwinCAT 2 licence)"),
    _ads(0x0011, "ERR_NODEBUGINTAVAILABLE", "no debugging available"),
    _ads(0x0012, "ERR_PORTDISABLED", "port disabled: the TwinCAT system service is not started"),
    _ads(0x0013, "ERR_PORTALREADYCONNECTED", "port already connected"),
    _ads(0x0014, "ERR_AMSSYNC_W32ERROR", "AMS sync: Win32 error"),
    _ads(0x0015, "ERR_AMSSYNC_TIMEOUT", "AMS sync: timeout"),
    _ads(0x0016, "ERR_AMSSYNC_AMSERROR", "AMS sync: AMS error"),
    _ads(0x0017, "ERR_AMSSYNC_NOINDEXINMAP", "AMS sync: no such index in the map"),
    _ads(0x0018, "ERR_INVALIDAMSPORT", "invalid AMS port"),
    _ads(0x0019, "ERR_NOMEMORY", "out of memory"),
    _ads(0x001A, "ERR_TCPSEND", "TCP could not send"),
    _ads(0x001B, "ERR_HOSTUNREACHABLE", "host cannot be reached"),
    _ads(0x001C, "ERR_INVALIDAMSFRAGMENT", "invalid AMS fragment"),
    _ads(0x001D, "ERR_TLSSEND", "TLS could not send: the secure ADS connection failed"),
    _ads(0x001E, "ERR_ACCESSDENIED", "secure ADS denied the access"),
)
"""The 31 global codes of the manual."""

ROUTER: Final = (
    _ads(0x0500, "ROUTERERR_NOLOCKEDMEMORY", "no locked memory for the router"),
    _ads(0x0501, "ROUTERERR_RESIZEMEMORY", "the router's memory could not be resized"),
    _ads(0x0502, "ROUTERERR_MAILBOXFULL", "the mailbox holds all the messages it can"),
    _ads(0x0503, "ROUTERERR_DEBUGBOXFULL", "the debug mailbox holds all the messages it can"),
    _ads(0x0504, "ROUTERERR_UNKNOWNPORTTYPE", "unknown port type"),
    _ads(0x0505, "ROUTERERR_NOTINITIALIZED", "router not initialised"),
    _ads(0x0506, "ROUTERERR_PORTALREADYINUSE", "port number already in use"),
    _ads(0x0507, "ROUTERERR_NOTREGISTERED", "port not registered"),
    _ads(0x0508, "ROUTERERR_NOMOREQUEUES", "no more ports available"),
    _ads(0x0509, "ROUTERERR_INVALIDPORT", "invalid port"),
    _ads(0x050A, "ROUTERERR_NOTACTIVATED", "router not active"),
    _ads(0x050B, "ROUTERERR_FRAGMENTBOXFULL", "the mailbox for fragments holds all the messages it can"),
    _ads(0x050C, "ROUTERERR_FRAGMENTTIMEOUT", "a fragment came too late"),
    _ads(0x050D, "ROUTERERR_TOBEREMOVED", "port is being removed"),
)
"""The 14 router codes of the manual."""

ADS: Final = (
    _ads(0x0700, "ADSERR_DEVICE_ERROR", "general device error"),
    _ads(0x0701, "ADSERR_DEVICE_SRVNOTSUPP", "service not supported by the server"),
    _ads(0x0702, "ADSERR_DEVICE_INVALIDGRP", "invalid index group"),
    _ads(0x0703, "ADSERR_DEVICE_INVALIDOFFSET", "invalid index offset"),
    _ads(0x0704, "ADSERR_DEVICE_INVALIDACCESS", "reading or writing not permitted"),
    _ads(0x0705, "ADSERR_DEVICE_INVALIDSIZE", "wrong parameter size"),
    _ads(0x0706, "ADSERR_DEVICE_INVALIDDATA", "invalid data"),
    _ads(0x0707, "ADSERR_DEVICE_NOTREADY", "device not ready"),
    _ads(0x0708, "ADSERR_DEVICE_BUSY", "device busy"),
    _ads(0x0709, "ADSERR_DEVICE_INVALIDCONTEXT", "invalid operating system context, e.g. ADS blocks used from several tasks"),
    _ads(0x070A, "ADSERR_DEVICE_NOMEMORY", "not enough memory"),
    _ads(0x070B, "ADSERR_DEVICE_INVALIDPARM", "invalid parameter"),
    _ads(0x070C, "ADSERR_DEVICE_NOTFOUND", "not found"),
    _ads(0x070D, "ADSERR_DEVICE_SYNTAX", "syntax error in a file or command"),
    _ads(0x070E, "ADSERR_DEVICE_INCOMPATIBLE", "objects do not match"),
    _ads(0x070F, "ADSERR_DEVICE_EXISTS", "object already exists"),
    _ads(0x0710, "ADSERR_DEVICE_SYMBOLNOTFOUND", "symbol not found"),
    _ads(
        0x0711,
        "ADSERR_DEVICE_SYMBOLVERSIONINVALID",
        "invalid symbol version, e.g. after an online change; a new handle is needed",
    ),
    _ads(0x0712, "ADSERR_DEVICE_INVALIDSTATE", "not possible in this state"),
    _ads(0x0713, "ADSERR_DEVICE_TRANSMODENOTSUPP", "transmission mode not supported"),
    _ads(0x0714, "ADSERR_DEVICE_NOTIFYHNDINVALID", "invalid notification handle"),
    _ads(0x0715, "ADSERR_DEVICE_CLIENTUNKNOWN", "notification client not registered"),
    _ads(0x0716, "ADSERR_DEVICE_NOMOREHDLS", "no more handles"),
    _ads(0x0717, "ADSERR_DEVICE_INVALIDWATCHSIZE", "notification too large"),
    _ads(0x0718, "ADSERR_DEVICE_NOTINIT", "not initialised"),
    _ads(0x0719, "ADSERR_DEVICE_TIMEOUT", "timeout"),
    _ads(0x071A, "ADSERR_DEVICE_NOINTERFACE", "interface not available"),
    _ads(0x071B, "ADSERR_DEVICE_INVALIDINTERFACE", "wrong interface asked for"),
    _ads(0x071C, "ADSERR_DEVICE_INVALIDCLSID", "invalid class id"),
    _ads(0x071D, "ADSERR_DEVICE_INVALIDOBJID", "invalid object id"),
    _ads(0x071E, "ADSERR_DEVICE_PENDING", "request pending"),
    _ads(0x071F, "ADSERR_DEVICE_ABORTED", "request aborted"),
    _ads(0x0720, "ADSERR_DEVICE_WARNING", "signal warning"),
    _ads(0x0721, "ADSERR_DEVICE_INVALIDARRAYIDX", "invalid array index"),
    _ads(0x0722, "ADSERR_DEVICE_SYMBOLNOTACTIVE", "symbol not active"),
    _ads(0x0723, "ADSERR_DEVICE_ACCESSDENIED", "access denied"),
    _ads(0x0724, "ADSERR_DEVICE_LICENSENOTFOUND", "licence missing"),
    _ads(0x0725, "ADSERR_DEVICE_LICENSEEXPIRED", "licence expired"),
    _ads(0x0726, "ADSERR_DEVICE_LICENSEEXCEEDED", "licence exceeded"),
    _ads(0x0727, "ADSERR_DEVICE_LICENSEINVALID", "licence invalid"),
    _ads(0x0728, "ADSERR_DEVICE_LICENSESYSTEMID", "licence is for another system id"),
    _ads(0x0729, "ADSERR_DEVICE_LICENSENOTIMELIMIT", "licence has no time limit"),
    _ads(0x072A, "ADSERR_DEVICE_LICENSEFUTUREISSUE", "licence was issued in the future"),
    _ads(0x072B, "ADSERR_DEVICE_LICENSETIMETOLONG", "licence period too long"),
    _ads(0x072C, "ADSERR_DEVICE_EXCEPTION", "exception at system start"),
    _ads(0x072D, "ADSERR_DEVICE_LICENSEDUPLICATED", "licence file read twice"),
    _ads(0x072E, "ADSERR_DEVICE_SIGNATUREINVALID", "invalid signature"),
    _ads(0x072F, "ADSERR_DEVICE_CERTIFICATEINVALID", "invalid certificate"),
    _ads(0x0730, "ADSERR_DEVICE_LICENSEOEMNOTFOUND", "the OEM's public key is not known"),
    _ads(0x0731, "ADSERR_DEVICE_LICENSERESTRICTED", "licence not valid for this system id"),
    _ads(0x0732, "ADSERR_DEVICE_LICENSEDEMODENIED", "demo licence not allowed"),
    _ads(0x0733, "ADSERR_DEVICE_INVALIDFNCID", "invalid function id"),
    _ads(0x0734, "ADSERR_DEVICE_OUTOFRANGE", "out of range"),
    _ads(0x0735, "ADSERR_DEVICE_INVALIDALIGNMENT", "invalid alignment"),
    _ads(0x0736, "ADSERR_DEVICE_LICENSEPLATFORM", "invalid platform level"),
    _ads(0x0737, "ADSERR_DEVICE_FORWARD_PL", "context: forward to passive level"),
    _ads(0x0738, "ADSERR_DEVICE_FORWARD_DL", "context: forward to dispatch level"),
    _ads(0x0739, "ADSERR_DEVICE_FORWARD_RT", "context: forward to real time"),
    _ads(0x0740, "ADSERR_CLIENT_ERROR", "client error"),
    _ads(0x0741, "ADSERR_CLIENT_INVALIDPARM", "invalid parameter in the service"),
    _ads(0x0742, "ADSERR_CLIENT_LISTEMPTY", "polling list empty"),
    _ads(0x0743, "ADSERR_CLIENT_VARUSED", "variable connection already in use"),
    _ads(0x0744, "ADSERR_CLIENT_DUPLINVOKEID", "invoke id already in use"),
    _ads(0x0745, "ADSERR_CLIENT_SYNCTIMEOUT", "the other side did not answer within the ADS timeout; its route may be wrong"),
    _ads(0x0746, "ADSERR_CLIENT_W32ERROR", "error in the Win32 subsystem"),
    _ads(0x0747, "ADSERR_CLIENT_TIMEOUTINVALID", "invalid client timeout"),
    _ads(0x0748, "ADSERR_CLIENT_PORTNOTOPEN", "port not open"),
    _ads(0x0749, "ADSERR_CLIENT_NOAMSADDR", "no AMS address"),
    _ads(0x0750, "ADSERR_CLIENT_SYNCINTERNAL", "internal error in ADS sync"),
    _ads(0x0751, "ADSERR_CLIENT_ADDHASH", "hash table overflow"),
    _ads(0x0752, "ADSERR_CLIENT_REMOVEHASH", "key not in the hash table"),
    _ads(0x0753, "ADSERR_CLIENT_NOMORESYM", "no symbols in the cache"),
    _ads(0x0754, "ADSERR_CLIENT_SYNCRESINVALID", "invalid response"),
    _ads(0x0755, "ADSERR_CLIENT_SYNCPORTLOCKED", "sync port locked"),
    _ads(0x0756, "ADSERR_CLIENT_REQUESTCANCELLED", "request cancelled"),
)
"""The 75 general ADS codes of the manual."""

RTIME: Final = (
    _ads(0x1000, "RTERR_INTERNAL", "internal error of the real-time system"),
    _ads(0x1001, "RTERR_BADTIMERPERIODS", "invalid timer value"),
    _ads(0x1002, "RTERR_INVALIDTASKPTR", "task pointer is 0"),
    _ads(0x1003, "RTERR_INVALIDSTACKPTR", "stack pointer is 0"),
    _ads(0x1004, "RTERR_PRIOEXISTS", "task priority already taken"),
    _ads(0x1005, "RTERR_NOMORETCB", "no free task control block (64 at most)"),
    _ads(0x1006, "RTERR_NOMORESEMAS", "no free semaphore (64 at most)"),
    _ads(0x1007, "RTERR_NOMOREQUEUES", "no free place in the queue (64 at most)"),
    _ads(0x100D, "RTERR_EXTIRQALREADYDEF", "an external sync interrupt is already applied"),
    _ads(0x100E, "RTERR_EXTIRQNOTDEF", "no external sync interrupt applied"),
    _ads(0x100F, "RTERR_EXTIRQINSTALLFAILED", "the external sync interrupt could not be applied"),
    _ads(0x1010, "RTERR_IRQLNOTLESSOREQUAL", "service function called in the wrong context"),
    _ads(0x1017, "RTERR_VMXNOTSUPPORTED", "Intel VT-x not supported"),
    _ads(0x1018, "RTERR_VMXDISABLED", "Intel VT-x disabled in the BIOS"),
    _ads(0x1019, "RTERR_VMXCONTROLSMISSING", "Intel VT-x lacks a function"),
    _ads(0x101A, "RTERR_VMXENABLEFAILS", "Intel VT-x could not be enabled"),
)
"""The 16 real-time codes of the manual."""

POSITIVE: Final = (
    Code(0x0000_0000, "S_OK", "no error"),
    Code(0x0000_0001, "S_FALSE", "no error, but a negative or incomplete result"),
    Code(0x0000_00B7, "ERROR_ALREADY_EXISTS", "no error, it existed already"),
    Code(0x0000_0203, "S_PENDING", "no error, but no result yet"),
    Code(0x0000_0256, "S_WATCHDOG_TIMEOUT", "no error, but it took too long"),
)
"""HRESULTs that are answers, not failures."""

GENERAL: Final = (
    Code(0x8000_4001, "E_NOTIMPL", "not implemented"),
    Code(0x8000_4003, "E_POINTER", "invalid pointer"),
    Code(0x8007_000E, "E_OUTOFMEMORY", "not enough memory"),
)
"""HRESULTs of Windows that a filter may give (manual 5.10.1)."""

WINSOCK: Final = (
    Code(10060, "WSAETIMEDOUT", "no connection: the host did not answer in time"),
    Code(10061, "WSAECONNREFUSED", "no connection: the host refused it, the service is probably not running"),
    Code(10065, "WSAEHOSTUNREACH", "no route to the host"),
)
"""Winsock's codes in the manual. Plain Win32 numbers, no HRESULTs: lookup() and by_name() do not know them."""

CODES: Final[tuple[Code, ...]] = (*GLOBAL, *ROUTER, *ADS, *RTIME, *POSITIVE, *GENERAL)
"""Every row that is an HRESULT."""

_BY_CODE: Final = {row.code: row for row in CODES}
_BY_NAME: Final = {name: row for row in CODES for name in (row.name, row.short_name)}

S_OK: Final = 0x0000_0000
S_FALSE: Final = 0x0000_0001
ERROR_ALREADY_EXISTS: Final = 0x0000_00B7
S_PENDING: Final = 0x0000_0203
S_WATCHDOG_TIMEOUT: Final = 0x0000_0256
E_NOTIMPL: Final = 0x8000_4001
E_POINTER: Final = 0x8000_4003
E_OUTOFMEMORY: Final = 0x8007_000E
ADS_E_ERROR: Final = 0x9811_0700
ADS_E_SRVNOTSUPP: Final = 0x9811_0701
ADS_E_INVALIDACCESS: Final = 0x9811_0704
ADS_E_INVALIDSIZE: Final = 0x9811_0705
ADS_E_INVALIDDATA: Final = 0x9811_0706
ADS_E_NOTREADY: Final = 0x9811_0707
ADS_E_BUSY: Final = 0x9811_0708
ADS_E_NOMEMORY: Final = 0x9811_070A
ADS_E_INVALIDPARM: Final = 0x9811_070B
ADS_E_NOTFOUND: Final = 0x9811_070C
ADS_E_SYNTAX: Final = 0x9811_070D
ADS_E_INCOMPATIBLE: Final = 0x9811_070E
ADS_E_EXISTS: Final = 0x9811_070F
ADS_E_SYMBOLNOTFOUND: Final = 0x9811_0710
ADS_E_INVALIDSTATE: Final = 0x9811_0712
ADS_E_NOMOREHDLS: Final = 0x9811_0716
ADS_E_NOMOREHDL: Final = ADS_E_NOMOREHDLS
"""The EventLogger manual's spelling of ADS_E_NOMOREHDLS."""
ADS_E_NOTINIT: Final = 0x9811_0718
ADS_E_TIMEOUT: Final = 0x9811_0719
ADS_E_NOINTERFACE: Final = 0x9811_071A
ADS_E_INVALIDINTERFACE: Final = 0x9811_071B
ADS_E_INVALIDCLSID: Final = 0x9811_071C
ADS_E_INVALIDOBJID: Final = 0x9811_071D
ADS_E_PENDING: Final = 0x9811_071E
ADS_E_ABORTED: Final = 0x9811_071F
ADS_E_ACCESSDENIED: Final = 0x9811_0723
ADS_E_EXCEPTION: Final = 0x9811_072C
ADS_E_OUTOFRANGE: Final = 0x9811_0734


def lookup(code: int) -> Code | None:
    """The row of an HRESULT, signed or unsigned; None when it has none. An ADS code goes through from_ads() first."""
    return _BY_CODE.get(code & 0xFFFF_FFFF)


def by_name(name: str) -> Code | None:
    """The row of a name in any case: ADSERR_DEVICE_INVALIDSTATE, ADS_E_INVALIDSTATE, S_OK; None when there is none."""
    return _BY_NAME.get(name.upper())


def name_of(code: int) -> str:
    """The short name of an HRESULT, or its number in hex."""
    row = lookup(code)
    return row.short_name if row is not None else f"0x{code & 0xFFFF_FFFF:08X}"


def from_ads(code: int) -> int:
    """The HRESULT of an ADS return code (0x712 gives 0x98110712, 0 gives 0x98110000); ValueError outside 0..0xFFFF."""
    if not 0 <= code <= 0xFFFF:
        raise ValueError(f"{code} is no ADS return code; expected 0..65535")
    return ADS_FACILITY | code


def from_signed(code: int) -> int:
    """A signed 32-bit HRESULT as the unsigned one (unsigned stays as it is); ValueError when it has more than 32 bits."""
    if not -(2**31) <= code < 2**32:
        raise ValueError(f"{code} is no HRESULT; expected 32 bits")
    return code & 0xFFFF_FFFF


def to_signed(code: int) -> int:
    """An unsigned HRESULT as the signed 32-bit one that PLC and C++ hold; ValueError as from_signed()."""
    unsigned = from_signed(code)
    return unsigned - 2**32 if unsigned >= 2**31 else unsigned


def failed(code: int) -> bool:
    """Whether the HRESULT is negative, signed or unsigned; ValueError as from_signed()."""
    return from_signed(code) >= 2**31


class AdsError(RuntimeError):
    """A call that was refused: its HRESULT (unsigned), the code's name and text, and what was refused in this case."""

    def __init__(self, code: int, detail: str = "") -> None:
        self.code = from_signed(code)
        self.name = name_of(self.code)
        row = lookup(self.code)
        self.text = row.text if row is not None else "unknown code"
        self.detail = detail
        super().__init__(self.code, detail)

    def __str__(self) -> str:
        number = f"0x{self.code:08X}"
        head = f"{self.name} ({number})" if self.name != number else number
        return f"{head}: {self.text}: {self.detail}" if self.detail else f"{head}: {self.text}"


def raise_if_failed(code: int, detail: str = "") -> int:
    """Return the HRESULT (unsigned) when it is an answer; AdsError when it is negative."""
    if failed(code):
        raise AdsError(code, detail)
    return from_signed(code)
