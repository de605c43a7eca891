/* Reads a package with cairn.h alone: prints its sections, and what the root and a few records say. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cairn.h"

static char *whole_file(const char *path, size_t *length) {
    FILE *file = fopen(path, "rb");
    char *bytes = NULL;
    long end;
    if (file == NULL || fseek(file, 0, SEEK_END) != 0 || (end = ftell(file)) < 0) {
        return NULL;
    }
    rewind(file);
    bytes = malloc((size_t)end + 1);
    *length = bytes == NULL ? 0 : fread(bytes, 1, (size_t)end, file);
    fclose(file);
    return bytes;
}

static void print_text(const char *label, const CairnString *text) {
    size_t length;
    const char *bytes = cairn_text(text, &length);
    printf("%s %.*s\n", label, (int)length, bytes);
}

int main(int count, char **arguments) {
    size_t length = 0;
    char *file = count == 2 ? whole_file(arguments[1], &length) : NULL;
    const CairnHeader *header = (const CairnHeader *)file;
    const CairnSectionEntry *table;
    const CairnScene *scene;
    const CairnSectionEntry *row;
    uint64_t i;
    if (file == NULL || length < sizeof(CairnHeader)) {
        return 2;
    }
    if (memcmp(header->magic, CAIRN_MAGIC, 8) != 0 || header->version != CAIRN_VERSION ||
        header->schema_hash != CAIRN_SCHEMA_HASH || header->file_length != length) {
        return 1;
    }
    table = (const CairnSectionEntry *)(file + sizeof(CairnHeader));
    for (i = 0; i < header->section_count; i += 1) {
        printf("section %u %u %llu %llu\n", (unsigned)table[i].kind, (unsigned)table[i].stride,
               (unsigned long long)table[i].offset, (unsigned long long)table[i].count);
    }
    scene = cairn_root(file);
    print_text("scene", &scene->name);
    printf("bounds %g %g %g\n", scene->bounds.max[0], scene->bounds.max[1], scene->bounds.max[2]);
    for (i = 0; i < scene->meshes.length; i += 1) {
        const CairnMesh *mesh = (const CairnMesh *)cairn_items(&scene->meshes) + i;
        print_text("mesh", &mesh->name);
    }
    for (i = 0; i < scene->images.length; i += 1) {
        const CairnImage *image = (const CairnImage *)cairn_items(&scene->images) + i;
        const CairnLevel *levels = (const CairnLevel *)cairn_items(&image->levels);
        print_text("image", &image->name);
        printf("size %u %u format %u role %u levels %llu last %llu\n", (unsigned)image->width, (unsigned)image->height,
               (unsigned)image->format, (unsigned)image->role, (unsigned long long)image->levels.length,
               (unsigned long long)levels[image->levels.length - 1].offset);
    }
    printf("environment %u\n", (unsigned)scene->environment.present);
    row = cairn_section(file, CAIRN_SECTION_VERTICES);
    if (row != NULL) {
        const CairnVertex *vertices = (const CairnVertex *)(file + row->offset);
        const CairnVertex *last = &vertices[row->count - 1];
        printf("last vertex %g %g %g\n", last->position[0], last->position[1], last->position[2]);
    }
    row = cairn_section(file, CAIRN_SECTION_MATERIALS);
    if (row != NULL) {
        const CairnMaterial *material = (const CairnMaterial *)(file + row->offset);
        printf("cutoff %g normal map %d\n", material->alpha_cutoff, material->normal_tex != CAIRN_NO_TEXTURE);
    }
    printf("lights %s\n", cairn_section(file, CAIRN_SECTION_PUNCTUAL_LIGHTS) == NULL ? "none" : "some");
    free(file);
    return 0;
}
