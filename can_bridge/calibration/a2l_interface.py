"""How a tool reaches the segment: the parts of the A2L file that describe XCP on CAN.

The meta language is what ASAM publishes with XCP (part 2, section "ASAM MCD-2 MC description file", and part 3), as far
as this ECU has it.
"""

from typing import Final

from can_bridge.calibration import xcp
from can_bridge.calibration.segment import Page
from can_bridge.calibration.xcp import Command
from contract.controller.calibration import PACKED_BYTES

_VERSION: Final = 0x0102
"""Version of protocol layer and transport layer in the description: 1.2 is the first with CAN FD."""
_TIMEOUTS_MS: Final = (1000, 1000, 1000, 1000, 1000, 1000, 1000)
"""T1 to T7: long against a control period, in which every command is answered."""
_MANDATORY: Final = frozenset(
    {Command.CONNECT, Command.DISCONNECT, Command.GET_STATUS, Command.SYNCH, Command.SET_CAL_PAGE, Command.GET_CAL_PAGE}
    | {Command.DOWNLOAD}
)

META_LANGUAGE: Final = """\
block "IF_DATA" taggedunion if_data {
  "XCP" struct {
    taggedstruct {
      block "PROTOCOL_LAYER" struct {
        uint; uint; uint; uint; uint; uint; uint; uint;
        uchar; uint;
        enum { "BYTE_ORDER_MSB_LAST" = 0, "BYTE_ORDER_MSB_FIRST" = 1 };
        enum { "ADDRESS_GRANULARITY_BYTE" = 1, "ADDRESS_GRANULARITY_WORD" = 2, "ADDRESS_GRANULARITY_DWORD" = 4 };
        taggedstruct {
          ("OPTIONAL_CMD" enum {
            "GET_COMM_MODE_INFO" = 251, "GET_ID" = 250, "SET_REQUEST" = 249, "GET_SEED" = 248, "UNLOCK" = 247,
            "SET_MTA" = 246, "UPLOAD" = 245,
            "SHORT_UPLOAD" = 244, "BUILD_CHECKSUM" = 243, "DOWNLOAD" = 240, "SET_CAL_PAGE" = 235, "GET_CAL_PAGE" = 234,
            "GET_PAG_PROCESSOR_INFO" = 233, "GET_SEGMENT_INFO" = 232, "GET_PAGE_INFO" = 231, "COPY_CAL_PAGE" = 228
          })*;
        };
      };
      block "SEGMENT" struct {
        uchar; uchar; uchar; uchar; uchar;
        taggedstruct {
          block "CHECKSUM" struct {
            enum {
              "XCP_ADD_11" = 1, "XCP_ADD_12" = 2, "XCP_ADD_14" = 3, "XCP_ADD_22" = 4, "XCP_ADD_24" = 5,
              "XCP_ADD_44" = 6, "XCP_CRC_16" = 7, "XCP_CRC_16_CITT" = 8, "XCP_CRC_32" = 9, "XCP_USER_DEFINED" = 255
            };
            taggedstruct { "MAX_BLOCK_SIZE" ulong; "EXTERNAL_FUNCTION" char[256]; };
          };
          (block "PAGE" struct {
            uchar;
            enum {
              "ECU_ACCESS_NOT_ALLOWED" = 0, "ECU_ACCESS_WITHOUT_XCP_ONLY" = 1, "ECU_ACCESS_WITH_XCP_ONLY" = 2,
              "ECU_ACCESS_DONT_CARE" = 3
            };
            enum {
              "XCP_READ_ACCESS_NOT_ALLOWED" = 0, "XCP_READ_ACCESS_WITHOUT_ECU_ONLY" = 1,
              "XCP_READ_ACCESS_WITH_ECU_ONLY" = 2, "XCP_READ_ACCESS_DONT_CARE" = 3
            };
            enum {
              "XCP_WRITE_ACCESS_NOT_ALLOWED" = 0, "XCP_WRITE_ACCESS_WITHOUT_ECU_ONLY" = 1,
              "XCP_WRITE_ACCESS_WITH_ECU_ONLY" = 2, "XCP_WRITE_ACCESS_DONT_CARE" = 3
            };
            taggedstruct { "INIT_SEGMENT" uchar; };
          })*;
        };
      };
      block "PAG" struct { uchar; taggedstruct { "FREEZE_SUPPORTED"; }; };
      block "XCP_ON_CAN" struct {
        uint;
        taggedstruct {
          "CAN_ID_MASTER" ulong;
          "CAN_ID_SLAVE" ulong;
          "BAUDRATE" ulong;
          block "CAN_FD" struct {
            taggedstruct { "MAX_DLC" uint; "CAN_FD_DATA_TRANSFER_BAUDRATE" ulong; };
          };
        };
      };
    };
  };
};
"""


def segment_interface() -> list[str]:
    """Lines that belong into the memory segment."""
    pages = {
        Page.WORKING: "XCP_WRITE_ACCESS_DONT_CARE",
        Page.REFERENCE: "XCP_WRITE_ACCESS_NOT_ALLOWED",
    }
    lines = ["/begin IF_DATA XCP", f"  /begin SEGMENT 0 {len(pages)} 0 0 0"]
    lines.append(f"    /begin CHECKSUM XCP_CRC_32 MAX_BLOCK_SIZE {PACKED_BYTES} /end CHECKSUM")
    for page, write_access in pages.items():
        lines += [
            f"    /begin PAGE {page} ECU_ACCESS_DONT_CARE XCP_READ_ACCESS_DONT_CARE {write_access}",
            "      INIT_SEGMENT 0",
            "    /end PAGE",
        ]
    return [*lines, "  /end SEGMENT", "/end IF_DATA"]


def module_interface(*, nominal_bitrate: int, data_bitrate: int | None) -> list[str]:
    """Lines that belong into the module; bit rates in bit/s, the second None for classic CAN."""
    optional = [f"    OPTIONAL_CMD {command.name}" for command in Command if command not in _MANDATORY]
    fd = []
    if data_bitrate is not None:
        fd = [
            "    /begin CAN_FD",
            f"      MAX_DLC {xcp.MAX_CTO}",
            f"      CAN_FD_DATA_TRANSFER_BAUDRATE {data_bitrate}",
            "    /end CAN_FD",
        ]
    return [
        "/begin IF_DATA XCP",
        f"  /begin PROTOCOL_LAYER {_VERSION:#06x} {' '.join(map(str, _TIMEOUTS_MS))} {xcp.MAX_CTO} {xcp.MAX_CTO}",
        "    BYTE_ORDER_MSB_LAST ADDRESS_GRANULARITY_BYTE",
        *optional,
        "  /end PROTOCOL_LAYER",
        "  /begin PAG 1 /end PAG",
        f"  /begin XCP_ON_CAN {_VERSION:#06x}",
        f"    CAN_ID_MASTER {xcp.COMMAND_ID:#05x}",
        f"    CAN_ID_SLAVE {xcp.RESPONSE_ID:#05x}",
        f"    BAUDRATE {nominal_bitrate}",
        *fd,
        "  /end XCP_ON_CAN",
        "/end IF_DATA",
    ]
