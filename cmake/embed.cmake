# cmake -DINPUT=file -DOUTPUT=base -DNAMESPACE=ns -DNAME=kName -P embed.cmake: base.h and base.cc with the file's bytes.
get_filename_component(base ${OUTPUT} NAME)
file(READ ${INPUT} bytes HEX)
string(REGEX REPLACE "(..)" "0x\\1," bytes "${bytes}")
file(WRITE ${OUTPUT}.h "#pragma once\n#include <cstddef>\nnamespace ${NAMESPACE} {\n"
  "extern const unsigned char ${NAME}[];\nextern const std::size_t ${NAME}Size;\n}\n")
file(WRITE ${OUTPUT}.cc "#include \"${base}.h\"\nnamespace ${NAMESPACE} {\n"
  "const unsigned char ${NAME}[] = {${bytes}};\nconst std::size_t ${NAME}Size = sizeof ${NAME};\n}\n")
