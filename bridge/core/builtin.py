"""Event classes that every TwinCAT system has: those of the ADS return codes and of Windows' codes, newest and older.

Rule 1: GUIDs, names, ids, severities and Hides are those of real class files (facts 2.6 and 7). The texts are our own: for ADS
codes those of hresult.py, for Windows' codes those below. A class file that knows the GUID is the better one: merge it last.
Rule 2: an event's id is the code itself: the ADS return code (0x712), or Windows' number (2, 10060).
Rule 3: 0 is no event of the ADS classes (conversion.py says what it is). ADSERR_CLIENT_ERROR (0x740) and
ADSERR_CLIENT_REQUESTCANCELLED (0x756) are in no known version.
Rule 4: the newest TcGeneralAdsEventClass hides the older one here, which its real file forgot; so each of these names has one
newest version.

Severity is Error in all of them but for Windows' code 0, which is Verbose.
"""

from functools import cache
from typing import Final, TypeAlias

import msgspec

from bridge.core import hresult
from bridge.core.catalog import Catalog, EventClass, EventEntry
from bridge.core.events import Severity

_Names: TypeAlias = tuple[tuple[int, str], ...]


def _sentence(text: str) -> str:
    return f"{text[0].upper()}{text[1:]}."


def _ads_text(code: int) -> str:
    row = hresult.lookup(hresult.from_ads(code))
    return _sentence(row.text) if row is not None else ""


def _winsock(code: int) -> str:
    return next(_sentence(row.text) for row in hresult.WINSOCK if row.code == code)


_SYSTEM: Final[_Names] = (
    (0x0001, "InternalError"),
    (0x0002, "NoRTime"),
    (0x0003, "AllocationLockedMemoryError"),
    (0x0004, "InsertMailboxError"),
    (0x0005, "WrongReceiveHMSG"),
    (0x0006, "TargetPortNotFound"),
    (0x0007, "TargetMachineNotFound"),
    (0x0008, "UnknownCommandID"),
    (0x0009, "BadTaskID"),
    (0x000A, "NoIO"),
    (0x000B, "UnknownAdsCommand"),
    (0x000C, "Win32Error"),
    (0x000D, "PortNotConnected"),
    (0x000E, "InvalidAdsLength"),
    (0x000F, "InvalidAdsNetID"),
    (0x0010, "LowInstallationLevel"),
    (0x0011, "NoDebugAvailable"),
    (0x0012, "PortDisabled"),
    (0x0013, "PortAlreadyConnected"),
    (0x0014, "AdsSyncWin32Error"),
    (0x0015, "AdsSyncTimeout"),
    (0x0016, "AdsSyncAmsError"),
    (0x0017, "AdsSyncNoIndexMap"),
    (0x0018, "InvalidAdsPort"),
    (0x0019, "NoMemory"),
    (0x001A, "TCPSendError"),
    (0x001B, "HostUnreachable"),
    (0x001C, "InvalidAMSFragment"),
    (0x001D, "AdsSecTLSSendError"),
    (0x001E, "AdsSecAccessDenied"),
)
_ROUTER: Final[_Names] = (
    (0x0500, "NoLockedMemory"),
    (0x0501, "ResizeMemory"),
    (0x0502, "MailboxFull"),
    (0x0503, "DebugBoxFull"),
    (0x0504, "UnknownPortType"),
    (0x0505, "NotInitialized"),
    (0x0506, "PortAlreadyInUse"),
    (0x0507, "NotRegistered"),
    (0x0508, "NoMoreQueues"),
    (0x0509, "InvalidPort"),
    (0x050A, "NotActivated"),
    (0x050B, "FragmentBoxFull"),
    (0x050C, "FragmentTimeout"),
    (0x050D, "ToBeRemoved"),
)
_GENERAL_ADS: Final[_Names] = (
    (0x0700, "GeneralDeviceError"),
    (0x0701, "ServiceNotSupported"),
    (0x0702, "InvalidIndexGroup"),
    (0x0703, "InvalidIndexOffset"),
    (0x0704, "InvalidAccess"),
    (0x0705, "InvalidSize"),
    (0x0706, "InvalidData"),
    (0x0707, "NotReady"),
    (0x0708, "Busy"),
    (0x0709, "InvalidContext"),
    (0x070A, "NoMemory"),
    (0x070B, "InvalidParam"),
    (0x070C, "NotFound"),
    (0x070D, "Syntax"),
    (0x070E, "Incompatible"),
    (0x070F, "AlreadyExists"),
    (0x0710, "SymbolNotFound"),
    (0x0711, "SymbolVersionInvalid"),
    (0x0712, "InvalidState"),
    (0x0713, "TransModeNotSupported"),
    (0x0714, "NotificationHandleInvalid"),
    (0x0715, "ClientUnknown"),
    (0x0716, "NoMoreHandles"),
    (0x0717, "InvalidWatchSize"),
    (0x0718, "NotInit"),
    (0x0719, "DeviceTimeout"),
    (0x071A, "NoInterface"),
    (0x071B, "InvalidInterface"),
    (0x071C, "InvalidClassID"),
    (0x071D, "InvalidObjectID"),
    (0x071E, "Pending"),
    (0x071F, "Aborted"),
    (0x0720, "SignalWarning"),
    (0x0721, "InvalidArrayIndex"),
    (0x0722, "SymbolNotActive"),
    (0x0723, "AccessDenied"),
    (0x0724, "LicenseMissing"),
    (0x0725, "LicenseExpired"),
    (0x0726, "LicenseExceeded"),
    (0x0727, "LicenseInvalid"),
    (0x0728, "LicenseSystemID"),
    (0x0729, "LicenseNoTimeLimit"),
    (0x072A, "LicenseFutureIssue"),
    (0x072B, "LicenseTimeTooLong"),
    (0x072C, "Exception"),
    (0x072D, "LicenseDuplicated"),
    (0x072E, "SignatureInvalid"),
    (0x072F, "CertificateInvalid"),
    (0x0730, "LicenseOEMNotFound"),
    (0x0731, "LicenseRestricted"),
    (0x0732, "LicenseDemoDenied"),
    (0x0733, "InvalidFunctionID"),
    (0x0734, "OutOfRange"),
    (0x0735, "InvalidAlignment"),
    (0x0736, "LicensePlatform"),
    (0x0737, "ForwardPassiveLevel"),
    (0x0738, "ForwardDispatchLevel"),
    (0x0739, "ForwardRealTime"),
    (0x0741, "InvalidServiceParam"),
    (0x0742, "ListEmpty"),
    (0x0743, "VariableConAlreadyInUse"),
    (0x0744, "InvokeIDAlreadyInUse"),
    (0x0745, "TimeoutElapsed"),
    (0x0746, "Win32Error"),
    (0x0747, "TimeoutInvalid"),
    (0x0748, "PortNotOpen"),
    (0x0749, "NoAMSAddr"),
    (0x0750, "SyncInternalError"),
    (0x0751, "AddHash"),
    (0x0752, "RemoveHash"),
    (0x0753, "NoMoreSymbols"),
    (0x0754, "SyncResInvalid"),
    (0x0755, "SyncPortLocked"),
)
_RTIME: Final[_Names] = (
    (0x1000, "InternalError"),
    (0x1001, "BadTimerPeriods"),
    (0x1002, "InvalidTaskPtr"),
    (0x1003, "InvalidStackPtr"),
    (0x1004, "PrioExists"),
    (0x1005, "NoMoreTCB"),
    (0x1006, "NoMoreSemas"),
    (0x1007, "NoMoreQueues"),
    (0x100D, "ExtIRQAlreadyDef"),
    (0x100E, "ExtIRQNotDef"),
    (0x100F, "ExtIRQInstallFailed"),
    (0x1010, "IRQNotLessOrEqual"),
    (0x1017, "VMXNotSupported"),
    (0x1018, "VMXDisabled"),
    (0x1019, "VMXControlsMissing"),
    (0x101A, "VMXEnableFails"),
)
_WIN32: Final = (
    (0, "ERROR_SUCCESS", "Done without an error."),
    (1, "ERROR_INVALID_FUNCTION", "Invalid function."),
    (2, "ERROR_FILE_NOT_FOUND", "File not found."),
    (3, "ERROR_PATH_NOT_FOUND", "Path not found."),
    (4, "ERROR_TOO_MANY_OPEN_FILES", "Too many files are open."),
    (5, "ERROR_ACCESS_DENIED", "Access denied."),
    (6, "ERROR_INVALID_HANDLE", "Invalid handle."),
    (8, "ERROR_NOT_ENOUGH_MEMORY", "Not enough memory for this command."),
    (13, "ERROR_INVALID_DATA", "Invalid data."),
    (21, "ERROR_NOT_READY", "Device not ready."),
    (22, "ERROR_BAD_COMMAND", "The device does not know the command."),
    (23, "ERROR_CRC", "Wrong checksum (CRC)."),
    (24, "ERROR_BAD_LENGTH", "Wrong length of a command."),
    (29, "ERROR_WRITE_FAULT", "Writing to the device failed."),
    (30, "ERROR_READ_FAULT", "Reading from the device failed."),
    (31, "ERROR_GEN_FAILURE", "A device of the system does not work."),
    (50, "ERROR_NOT_SUPPORTED", "Request not supported."),
    (51, "ERROR_REM_NOT_LIST", "Remote computer not available."),
    (52, "ERROR_DUP_NAME", "The name exists twice on the network."),
    (53, "ERROR_BAD_NETPATH", "Network path not found."),
    (54, "ERROR_NETWORK_BUSY", "Network busy."),
    (55, "ERROR_DEV_NOT_EXIST", "The network device is no longer there."),
    (80, "ERROR_FILE_EXISTS", "The file exists already."),
    (82, "ERROR_CANNOT_MAKE", "The file or folder cannot be made."),
    (85, "ERROR_ALREADY_ASSIGNED", "The local device name is taken."),
    (86, "ERROR_INVALID_PASSWORD", "Wrong network password."),
    (87, "ERROR_INVALID_PARAMETER", "Wrong parameter."),
    (110, "ERROR_OPEN_FAILED", "The device or file cannot be opened."),
    (183, "ERROR_ALREADY_EXISTS", "It exists already."),
    (186, "ERROR_INVALID_FLAG_NUMBER", "Wrong flag."),
    (258, "WAIT_TIMEOUT", "The wait took too long."),
    (259, "ERROR_NO_MORE_ITEMS", "No more data."),
    (487, "ERROR_INVALID_ADDRESS", "Invalid address."),
    (534, "ERROR_ARITHMETIC_OVERFLOW", "The result has more than 32 bits."),
    (995, "ERROR_OPERATION_ABORTED", "Input or output was aborted: the thread ended or the program asked for it."),
    (996, "ERROR_IO_INCOMPLETE", "Overlapped input or output not complete yet."),
    (997, "ERROR_IO_PENDING", "Overlapped input or output in progress."),
    (10004, "WSAEINTR", "A blocking call was interrupted."),
    (10009, "WSAEBADF", "Invalid file handle."),
    (10013, "WSAEACCES", "The socket's access rights do not allow it."),
    (10014, "WSAEFAULT", "Invalid pointer in a call."),
    (10022, "WSAEINVAL", "Invalid argument."),
    (10024, "WSAEMFILE", "Too many sockets are open."),
    (10035, "WSAEWOULDBLOCK", "A non-blocking call cannot be done at once."),
    (10036, "WSAEINPROGRESS", "A blocking call is in progress."),
    (10037, "WSAEALREADY", "A non-blocking socket is busy with an earlier call."),
    (10038, "WSAENOTSOCK", "Not a socket."),
    (10039, "WSAEDESTADDRREQ", "The destination address is missing."),
    (10040, "WSAEMSGSIZE", "The datagram is larger than a buffer or the network allows."),
    (10041, "WSAEPROTOTYPE", "The protocol does not fit the type of the socket."),
    (10042, "WSAENOPROTOOPT", "Unknown or unsupported option or level."),
    (10043, "WSAEPROTONOSUPPORT", "The protocol is not configured."),
    (10044, "WSAESOCKTNOSUPPORT", "The address family has no such type of socket."),
    (10045, "WSAEOPNOTSUPP", "The socket does not support the operation."),
    (10046, "WSAEPFNOSUPPORT", "The protocol family is not configured."),
    (10047, "WSAEAFNOSUPPORT", "The address does not fit the protocol."),
    (10048, "WSAEADDRINUSE", "The address and port are in use."),
    (10049, "WSAEADDRNOTAVAIL", "The address is not one of this machine."),
    (10050, "WSAENETDOWN", "The network is down."),
    (10051, "WSAENETUNREACH", "The network cannot be reached."),
    (10052, "WSAENETRESET", "The connection was dropped, its keep-alive failed."),
    (10053, "WSAECONNABORTED", "This machine gave the connection up."),
    (10054, "WSAECONNRESET", "The other side closed the connection by force."),
    (10055, "WSAENOBUFS", "No buffer space or queue for the socket."),
    (10056, "WSAEISCONN", "The socket is connected already."),
    (10057, "WSAENOTCONN", "The socket is not connected."),
    (10058, "WSAESHUTDOWN", "The socket was shut down in that direction."),
    (10059, "WSAETOOMANYREFS", "A kernel object has too many references."),
    (10060, "WSAETIMEDOUT", _winsock(10060)),
    (10061, "WSAECONNREFUSED", _winsock(10061)),
    (10062, "WSAELOOP", "The name cannot be resolved, it leads in a circle."),
    (10063, "WSAENAMETOOLONG", "The name is too long."),
    (10064, "WSAEHOSTDOWN", "The host is down."),
    (10065, "WSAEHOSTUNREACH", _winsock(10065)),
    (10066, "WSAENOTEMPTY", "The folder is not empty."),
    (10067, "WSAEPROCLIM", "Too many programs use Windows Sockets."),
    (10068, "WSAEUSERS", "The user's quota is used up."),
    (10069, "WSAEDQUOT", "The disk quota is used up."),
    (10070, "WSAESTALE", "The file handle points to nothing any more."),
    (10071, "WSAEREMOTE", "The item is not on this machine."),
    (10091, "WSASYSNOTREADY", "The network subsystem is not ready."),
    (10092, "WSAVERNOTSUPPORTED", "This version of Windows Sockets is not supported."),
    (10093, "WSANOTINITIALISED", "Windows Sockets was not started in this program."),
    (10101, "WSAEDISCON", "The other side is closing the connection in order."),
    (10102, "WSAENOMORE", "The look-up has no more results."),
    (10103, "WSAECANCELLED", "The look-up was cancelled."),
    (10104, "WSAEINVALIDPROCTABLE", "Invalid table of procedures."),
    (10105, "WSAEINVALIDPROVIDER", "Invalid service provider."),
    (10106, "WSAEPROVIDERFAILEDINIT", "The service provider could not be loaded or started."),
    (10107, "WSASYSCALLFAILURE", "A system call failed that never should."),
    (10108, "WSASERVICE_NOT_FOUND", "Unknown service."),
    (10109, "WSATYPE_NOT_FOUND", "Unknown class of service."),
    (10110, "WSA_E_NO_MORE", "The service query has no more results."),
    (10111, "WSA_E_CANCELLED", "The service query was cancelled."),
    (10112, "WSAEREFUSED", "The query was refused."),
    (11001, "WSAHOST_NOT_FOUND", "Unknown host."),
    (11002, "WSATRY_AGAIN", "The host's name could not be resolved now; trying again may help."),
    (11003, "WSANO_RECOVERY", "The look-up of a host failed for good."),
    (11004, "WSANO_DATA", "The host's name exists, but has no data of the asked type."),
)


class _Version(msgspec.Struct, frozen=True):
    """One version of a class: it has all events of its table but those it lacks."""

    guid: str
    name: str
    events: tuple[EventEntry, ...]
    lacks: range = range(0)
    hides: tuple[str, ...] = ()

    def event_class(self) -> EventClass:
        events = {entry.id: entry for entry in self.events if entry.id not in self.lacks}
        return EventClass(self.guid, self.name, self.name, events, hides=self.hides)


def _ads(names: _Names) -> tuple[EventEntry, ...]:
    return tuple(EventEntry(code, name, Severity.ERROR, _ads_text(code)) for code, name in names)


def _win32() -> tuple[EventEntry, ...]:
    return tuple(EventEntry(code, name, Severity.ERROR if code else Severity.VERBOSE, text) for code, name, text in _WIN32)


TC_SYSTEM: Final = "bb2a9999-102e-421a-8d3d-b0660e07b1fe"
TC_ROUTER: Final = "e759605a-2341-48fc-9f3f-c8fa405c4b24"
TC_GENERAL_ADS: Final = "7d760066-d373-4a0c-b0f1-328b1620b0f0"
TC_RTIME: Final = "b63588ae-b30a-4dce-a44f-f929fb114944"
WIN32: Final = "4abefbbf-6620-4349-91ad-e6110a3be851"

_VERSIONS: Final = (
    _Version("11f7fc20-dbf4-4daf-96c7-1fd6b6156b31", "TcSystemEventClass", _ads(_SYSTEM), range(29, 31)),
    _Version(
        TC_SYSTEM,
        "TcSystemEventClass",
        _ads(_SYSTEM),
        hides=(
            "11f7fc20-dbf4-4daf-96c7-1fd6b6156b31",
            "b2bbe2af-d093-4b0f-be44-fcf3140a3212",
            "ef57fa70-34c2-47f2-b661-d7ffbec2c9a9",
            "ef9200fe-e527-4de7-bf5a-c4237524b2d2",
        ),
    ),
    _Version("e3d84344-4cb3-44db-8d94-12f9ce0e2f90", "TcRouterEventClass", _ads(_ROUTER)),
    _Version(
        TC_ROUTER,
        "TcRouterEventClass",
        _ads(_ROUTER),
        hides=("e3d84344-4cb3-44db-8d94-12f9ce0e2f90", "87452e42-edd9-4dff-ae3d-f4ed89f67122"),
    ),
    _Version(
        "98bcb284-f932-4ea4-b58b-68a1f1c34192",
        "TcGeneralAdsEventClass",
        _ads(_GENERAL_ADS),
        range(1838, 1850),
        ("8d937c5b-9a96-4a48-aa0b-bc30cc416a59",),
    ),
    _Version(
        TC_GENERAL_ADS,
        "TcGeneralAdsEventClass",
        _ads(_GENERAL_ADS),
        hides=(
            "8d937c5b-9a96-4a48-aa0b-bc30cc416a59",
            "b9b139a7-f4ef-4029-ad7b-4532cd350f16",
            "2ca2b7c4-0a28-4a21-b6e4-7e1f3cafa028",
            "c9b29370-3e32-4d90-82d4-71f4a1dd0ffd",
            "3d60dd34-7572-4daf-a600-0029a8a10d05",
            "4aadd072-a113-4a0c-bca5-5da1f921499a",
            "fdc026e1-568d-488a-ba3a-d57f287e3bc6",
            "98bcb284-f932-4ea4-b58b-68a1f1c34192",
        ),
    ),
    _Version(TC_RTIME, "TcRTimeEventClass", _ads(_RTIME)),
    _Version(
        "1d0c4bac-ecf3-4f33-8f20-a12e77ab6387",
        "Win32EventClass",
        _win32(),
        range(10004, 11005),
        ("3feaa938-d042-4b1e-8add-bb2f7be872b0",),
    ),
    _Version(
        WIN32,
        "Win32EventClass",
        _win32(),
        hides=("3feaa938-d042-4b1e-8add-bb2f7be872b0", "1d0c4bac-ecf3-4f33-8f20-a12e77ab6387"),
    ),
)

BUILTIN: Final = tuple(version.event_class() for version in _VERSIONS)
"""Every known version, older ones first."""


@cache
def builtin_catalog() -> Catalog:
    """The built-in classes as a catalog; merge class files into it: builtin_catalog().merged(files)."""
    return Catalog(BUILTIN)
